//! Storage with any cells changed: no panic; what is stored afterwards without an error is read again, by
//! this store and after a restart.
#![no_main]
#![allow(dead_code, reason = "the flash of the store's tests has more than one user")]

#[path = "../../store/tests/flash/mod.rs"]
mod flash;

use flash::{Flash, load, now};
use funnelnet_protocol::NodeConfig;
use funnelnet_store::{Change, Store};
use libfuzzer_sys::fuzz_target;
use std::ops::Range;
use std::sync::LazyLock;

type Chip = Flash<8, 2048>;
const REGION: Range<u32> = 0..4 * 2048;

fn config(id: u8) -> NodeConfig {
    NodeConfig::builder(id, 1_000_000).edge(id + 1, 1.0).build().expect("room for one edge")
}

/// A chip that has a configuration. It is the same for every input, so it is made once.
fn stored() -> Chip {
    let mut store = now(Store::open(Chip::new(4), REGION)).expect("an erased flash opens");
    now(async {
        store.stage(Change::Config(&config(3))).await?;
        store.commit(1).await
    })
    .expect("an erased flash stores");
    store.release()
}

fuzz_target!(|edits: Vec<(u16, u8)>| {
    static STORED: LazyLock<Chip> = LazyLock::new(stored);
    let mut chip = if edits.len() % 2 == 0 { STORED.clone() } else { Chip::new(4) };
    for (at, bits) in edits {
        let at = usize::from(at) % chip.bytes.len();
        chip.bytes[at] ^= bits;
    }
    let Ok(mut store) = now(Store::open(chip, REGION)) else { return };
    let _ = now(load(&mut store));
    let _ = now(store.key());
    let next = config(7);
    let epoch = store.epoch();
    let stored = now(async {
        store.stage(Change::Config(&next)).await?;
        store.commit(epoch.saturating_add(1)).await
    });
    if stored.is_ok() {
        assert_eq!(now(load(&mut store)).ok().flatten().as_ref(), Some(&next));
        let mut again = now(Store::open(store.release(), REGION)).expect("what was stored opens");
        assert_eq!(now(load(&mut again)).ok().flatten().as_ref(), Some(&next));
    }
});
