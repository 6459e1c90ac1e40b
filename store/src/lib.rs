//! A node's configuration in flash, and its key.
//!
//! The region has two halves, each a key-value map of `sequential-storage` with at most three records:
//!
//! | key | record |
//! |---|---|
//! | 0 | the configuration: `Option<NodeConfig>` in postcard, `None` for a node that was made blank on purpose |
//! | 2 | the key, where there is one |
//! | 1 | the [`commit`](record::Commit): layout, epoch, CRC-32 over all of them; written last |
//!
//! [`Store::stage`] erases the half that is not current and writes a configuration there, with the key of the
//! current one. [`Store::commit`] adds the commit record with a larger epoch, which makes that half the
//! current one: a short write and no erase. Nothing ever writes or erases the current half, but for what a
//! new key or a blank node has replaced, so a power cut leaves the old configuration or the new one, whatever
//! an interrupted write or erase leaves in the other half.
//!
//! Why not one map over the whole region: `sequential-storage` then moves live records out of a page before
//! it erases that page, and takes up an interrupted move from the page again. That is right where an erase
//! begins at the front. Cells erase in any order: where a page's marks survive the cut and its records do
//! not, they are lost (3 of 39,144 cut points of 29 configurations, `sequential-storage` 8.0.2, 2026-11-24,
//! with the flash of tests/flash).
#![no_std]
#![forbid(unsafe_code)]

pub mod error;
mod guard;
pub mod layout;
pub mod record;
pub mod split;
mod task;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::serial::MAX_BODY;
use funnelnet_protocol::service::Key;
use sequential_storage::cache::Cache;
use sequential_storage::map::{MapConfig, MapStorage, SerializationError, Value};

pub use error::Error;
use guard::{Guard, GuardError};
use layout::LAYOUT;
use record::{Commit, checksum};

/// Keys of the records.
const CONFIG: u8 = 0;
const COMMIT: u8 = 1;
const KEY: u8 = 2;

/// Longest configuration, bytes: the longest body of a CONFIGURE and the one byte of the `Option`
/// (`the_longest_fits`, tests/layout.rs).
pub const MAX_CONFIG: usize = MAX_BODY + 1;
/// Room for a configuration and its key, in whole words of any flash (32 bytes).
const BUFFER: usize = (MAX_CONFIG + 1).next_multiple_of(32);
/// How often a commit record is read before it counts: a cell that an interrupted write or erase has left in
/// between reads one way now and another way later, and what counts at one start has to count at the next.
const READS: usize = 3;
/// Smallest page, bytes: all records fit into the first one, so that no map ever moves a record.
pub const MIN_PAGE: usize = 2048;
/// Smallest region, pages: two for each half.
pub const MIN_PAGES: u32 = 4;

/// One of the halves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Half {
    Low,
    High,
}

impl Half {
    fn other(self) -> Self {
        match self {
            Self::Low => Self::High,
            Self::High => Self::Low,
        }
    }
}

/// What is staged.
pub enum Change<'a> {
    /// A configuration, with the current key.
    Config(&'a NodeConfig),
    /// A blank node without a key.
    Blank,
    /// The current configuration with this key; room to put it meanwhile, which need not be the store's.
    Key(Key, &'a mut Option<NodeConfig>),
}

/// What waits for its commit.
#[derive(Clone, Copy)]
struct Staged {
    half: Half,
    /// The [`checksum`] of it at epoch 0.
    crc: u32,
    /// What is current now must not be readable after the commit.
    replaces: bool,
}

/// The stored configuration of a node. Dropping a future of it is a power cut: call [`Store::open`] again.
pub struct Store<S> {
    flash: S,
    region: Range<u32>,
    current: Option<(Half, Commit)>,
    /// What was staged since the start.
    staged: Option<Staged>,
    buffer: [u8; BUFFER],
    /// See [`Guard`].
    seen: u32,
}

impl<S: NorFlash> Store<S> {
    /// A store in `region` of `flash` (byte addresses of the driver) that nobody has looked into: for
    /// [`Store::find`], once it is where it stays. What it is moved through on its way there is stack, 1.4
    /// KiB each time.
    pub const fn new(flash: S, region: Range<u32>) -> Self {
        Self { flash, region, current: None, staged: None, buffer: [0; BUFFER], seen: 0 }
    }

    /// Finds the current configuration; reads only. A stage that was not committed is no longer there. Flash
    /// that holds anything else is a store without a configuration, and a half that the driver cannot read is
    /// as one without a record.
    ///
    /// # Errors
    /// `Region` where it does not consist of at least [`MIN_PAGES`] whole pages, an even number, of at least
    /// [`MIN_PAGE`] bytes.
    pub async fn find(&mut self) -> Result<(), Error<S::Error>> {
        check_region::<S>(&self.region)?;
        let _ = self.look().await;
        Ok(())
    }

    /// A store that has [found](Self::find) what is current.
    ///
    /// # Errors
    /// As for [`Store::find`].
    pub async fn open(flash: S, region: Range<u32>) -> Result<Self, Error<S::Error>> {
        let mut store = Self::new(flash, region);
        store.find().await?;
        Ok(store)
    }

    /// Epoch of the current configuration, 0 where there has never been one.
    pub fn epoch(&self) -> u32 {
        self.current.map_or(0, |(_, commit)| commit.epoch)
    }

    /// Puts the current configuration into `room`; `None` where there is none.
    ///
    /// # Errors
    /// `Newer` for one that later firmware has stored, `Corrupt` for one that has changed since it was
    /// committed, `Flash`. None of them prevents a new one from being staged and committed. The room is empty
    /// then.
    pub async fn load(&mut self, room: &mut Option<NodeConfig>) -> Result<(), Error<S::Error>> {
        *room = None;
        let Some((half, commit)) = self.current else { return Ok(()) };
        let (_, bytes) = self.committed(half, commit).await?;
        layout::read(commit.layout, bytes, room).map_err(|_| Error::Corrupt)
    }

    /// The key beside the current configuration, which may be that of a blank node; `None` where there is
    /// none.
    ///
    /// # Errors
    /// As for [`Store::load`].
    pub async fn key(&mut self) -> Result<Option<Key>, Error<S::Error>> {
        let Some((half, commit)) = self.current else { return Ok(None) };
        Ok(self.committed(half, commit).await?.0)
    }

    /// Writes what is to be beside what is current, which stays. A key that cannot be read any more, since
    /// its record is damaged or of later firmware, does not come along.
    ///
    /// # Errors
    /// `Flash`, `Corrupt` where the flash does not keep what is written; with a key, too, what
    /// [`Store::load`] fails with. Nothing is staged then.
    pub async fn stage(&mut self, change: Change<'_>) -> Result<(), Error<S::Error>> {
        self.spare().await?;
        let replaces = !matches!(change, Change::Config(_));
        let (config, key) = match change {
            Change::Config(config) => match self.key().await {
                Err(Error::Corrupt | Error::Newer { .. }) => (Some(config), None),
                key => (Some(config), key?),
            },
            Change::Blank => (None, None),
            Change::Key(key, room) => {
                self.load(room).await?;
                (room.as_ref(), Some(key))
            }
        };
        self.put(config, key, replaces).await
    }

    /// Puts what a commit would make the current configuration into `room`.
    ///
    /// # Errors
    /// `NotStaged`; `Corrupt` where it has changed since it was staged; `Flash`.
    pub async fn staged(&mut self, room: &mut Option<NodeConfig>) -> Result<(), Error<S::Error>> {
        let Staged { half, crc, .. } = self.staged.ok_or(Error::NotStaged)?;
        let (_, bytes) = self.checked(half, LAYOUT, 0, crc).await?;
        layout::read(LAYOUT, bytes, room).map_err(|_| Error::Corrupt)
    }

    /// Makes the staged configuration the current one. A power cut leaves the one or the other. After a key
    /// or a blank node the half of before is erased: neither an old key nor what a blank node was can be read
    /// from the flash any more.
    ///
    /// # Errors
    /// `NotStaged`; `Epoch` unless `epoch` is larger than the [present one](Self::epoch); `Corrupt`, `Flash`:
    /// then the old one stays until the next [`Store::open`] or [`Store::stage`], which finds the one or the
    /// other, since the record may be written; or the new one counts, and the old half could not be erased,
    /// which the same change once more makes up for.
    pub async fn commit(&mut self, epoch: u32) -> Result<(), Error<S::Error>> {
        if epoch <= self.epoch() {
            return Err(Error::Epoch { present: self.epoch() });
        }
        let Staged { half, crc, replaces } = self.staged.take().ok_or(Error::NotStaged)?;
        let (key, bytes) = self.checked(half, LAYOUT, 0, crc).await?;
        let commit = Commit { layout: LAYOUT, epoch, crc: checksum(LAYOUT, epoch, key.as_ref(), bytes) };
        self.write(half, COMMIT, &Record::Bytes(&commit.encode())).await?;
        if self.read_commit(half).await? != Some(commit) {
            return Err(Error::Corrupt);
        }
        self.current = Some((half, commit));
        if replaces { self.erase(half.other()).await } else { Ok(()) }
    }

    /// The half that the next change erases and writes: whatever is in it, nothing of it is current. What was staged and
    /// not committed is there.
    ///
    /// # Errors
    /// Of a half that cannot be read and may hold what is current.
    pub async fn spare(&mut self) -> Result<Range<u32>, Error<S::Error>> {
        // A commit that has failed may be there all the same. Then it is what counts, and its half must not
        // be erased.
        match self.look().await {
            // Erased is what it is going to be. The other half could hold what counts more than anything that
            // is written now.
            Some((half, error)) if half != self.target() => Err(error),
            _ => Ok(self.range(self.target())),
        }
    }

    /// The flash, for drivers that need attention. What is changed through it is the caller's risk.
    pub fn flash(&mut self) -> &mut S {
        &mut self.flash
    }

    /// The flash, for the next user.
    pub fn release(self) -> S {
        self.flash
    }

    /// Finds what is current; gives a half that cannot be read, and why.
    async fn look(&mut self) -> Option<(Half, Error<S::Error>)> {
        let mut unread = None;
        for half in [Half::Low, Half::High] {
            match self.read_commit(half).await {
                Ok(Some(commit)) if commit.epoch > self.epoch() => self.current = Some((half, commit)),
                Ok(_) => {}
                Err(error) => unread = Some((half, error)),
            }
        }
        unread
    }

    /// Where the next change is written.
    fn target(&self) -> Half {
        self.current.map_or(Half::Low, |(half, _)| half.other())
    }

    async fn erase(&mut self, half: Half) -> Result<(), Error<S::Error>> {
        let range = self.range(half);
        self.flash.erase(range.start, range.end).await.map_err(Error::Flash)
    }

    /// Writes both beside what is current, and looks whether they are there.
    async fn put(
        &mut self,
        config: Option<&NodeConfig>,
        key: Option<Key>,
        replaces: bool,
    ) -> Result<(), Error<S::Error>> {
        self.staged = None;
        let half = self.target();
        if self.current.is_none() {
            // A record in there that could not be read now would count for more than the first one of a new
            // row.
            self.erase(half.other()).await?;
        }
        self.erase(half).await?;
        self.write(half, CONFIG, &Record::Config(config)).await?;
        if let Some(Key(bytes)) = &key {
            self.write(half, KEY, &Record::Bytes(bytes)).await?;
        }
        let (written_key, written) = self.contents(half, LAYOUT).await?;
        // Serialized once more, and only summed up, for want of a second buffer.
        let same = match (config, written) {
            (Some(config), [1, bytes @ ..]) => config.checksum() == NodeConfig::checksum_of(bytes),
            (config, bytes) => config.is_none() && bytes == [0],
        };
        if !same || written_key != key {
            return Err(Error::Corrupt);
        }
        let crc = checksum(LAYOUT, 0, key.as_ref(), written);
        self.staged = Some(Staged { half, crc, replaces });
        Ok(())
    }

    async fn committed(
        &mut self,
        half: Half,
        Commit { layout, epoch, crc }: Commit,
    ) -> Result<(Option<Key>, &[u8]), Error<S::Error>> {
        if layout > LAYOUT {
            return Err(Error::Newer { layout });
        }
        self.checked(half, layout, epoch, crc).await
    }

    /// Key and configuration of a half, which have this checksum.
    async fn checked(
        &mut self,
        half: Half,
        layout: u8,
        epoch: u32,
        crc: u32,
    ) -> Result<(Option<Key>, &[u8]), Error<S::Error>> {
        let (key, bytes) = self.contents(half, layout).await?;
        if checksum(layout, epoch, key.as_ref(), bytes) != crc {
            return Err(Error::Corrupt);
        }
        Ok((key, bytes))
    }

    async fn contents(&mut self, half: Half, layout: u8) -> Result<(Option<Key>, &[u8]), Error<S::Error>> {
        let key = match layout::has_key(layout) {
            true => self.read(half, KEY).await?.and_then(|bytes| bytes.try_into().ok()).map(Key),
            false => None,
        };
        let bytes = self.read(half, CONFIG).await?.ok_or(Error::Corrupt)?;
        Ok((key, bytes))
    }

    fn range(&self, half: Half) -> Range<u32> {
        let middle = self.region.start + (self.region.end - self.region.start) / 2;
        match half {
            Half::Low => self.region.start..middle,
            Half::High => middle..self.region.end,
        }
    }

    /// The commit record of a half; `None`, too, where not all that leads to it reads the same each time: a
    /// map that reads a record wrong reads it once more, and says nothing of it.
    async fn read_commit(&mut self, half: Half) -> Result<Option<Commit>, Error<S::Error>> {
        let mut first = None;
        for _ in 0..READS {
            self.seen = 0;
            let Some(commit) = self.read(half, COMMIT).await?.and_then(Commit::decode) else {
                return Ok(None);
            };
            if *first.get_or_insert((commit, self.seen)) != (commit, self.seen) {
                return Ok(None);
            }
        }
        Ok(first.map(|(commit, _)| commit))
    }

    /// A record, `None` where there is none that can be read. Never writes: repairs are for a half that is
    /// going to be erased anyway.
    async fn read(&mut self, half: Half, key: u8) -> Result<Option<&[u8]>, Error<S::Error>> {
        let config = MapConfig::try_new(self.range(half)).map_err(|_| Error::Region)?;
        let flash = Guard { flash: &mut self.flash, may_change: false, seen: &mut self.seen };
        let mut map = MapStorage::<u8, _, _>::new(flash, config, Cache::new_uncached());
        match map.fetch_item(&mut self.buffer, &key).await {
            Ok(record) => Ok(record),
            Err(sequential_storage::Error::Storage { value: GuardError::Flash(error), .. }) => {
                Err(Error::Flash(error))
            }
            Err(_) => Ok(None),
        }
    }

    async fn write(&mut self, half: Half, key: u8, record: &Record<'_>) -> Result<(), Error<S::Error>> {
        let config = MapConfig::try_new(self.range(half)).map_err(|_| Error::Region)?;
        let flash = Guard { flash: &mut self.flash, may_change: true, seen: &mut self.seen };
        let mut map = MapStorage::<u8, _, _>::new(flash, config, Cache::new_uncached());
        map.store_item(&mut self.buffer, &key, record).await.map_err(|error| match error {
            sequential_storage::Error::Storage { value: GuardError::Flash(error), .. } => Error::Flash(error),
            _ => Error::Corrupt,
        })
    }
}

/// What is written: one type, for one copy of the map in the image.
enum Record<'a> {
    Config(Option<&'a NodeConfig>),
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> for Record<'_> {
    fn serialize_into(&self, buffer: &mut [u8]) -> Result<usize, SerializationError> {
        let bytes = match self {
            Self::Config(config) => postcard::to_slice(config, buffer).map(|bytes| bytes.len()).ok(),
            Self::Bytes(bytes) => buffer.get_mut(..bytes.len()).map(|room| {
                room.copy_from_slice(bytes);
                bytes.len()
            }),
        };
        bytes.ok_or(SerializationError::BufferTooSmall)
    }

    fn deserialize_from(_: &'a [u8]) -> Result<(Self, usize), SerializationError> {
        Err(SerializationError::InvalidFormat) // records are read as bytes
    }
}

fn check_region<S: NorFlash>(region: &Range<u32>) -> Result<(), Error<S::Error>> {
    let page = S::ERASE_SIZE as u32;
    let length = region.end.checked_sub(region.start).ok_or(Error::Region)?;
    let fits = region.start.is_multiple_of(page)
        && length.is_multiple_of(2 * page)
        && length / page >= MIN_PAGES
        && S::ERASE_SIZE >= MIN_PAGE;
    if fits { Ok(()) } else { Err(Error::Region) }
}
