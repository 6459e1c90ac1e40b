//! Decoders are total, encoders and decoders agree, and the stated maximum sizes are the real ones.
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_protocol::config::{
    Breach, ConfigError, Coupling, EdgeConfig, Field, Funnel, Gain, HeardLimits, Limits, MAX_COMPONENTS,
    MAX_MATRIX, MAX_NEIGHBOURS, MAX_SINES, NodeConfig, Normalised, Program, Shape, Sine, TickSource,
    TimeRules, Tuning,
};
use funnelnet_protocol::message::{Component, Message, NodeId, TickStamp};
use funnelnet_protocol::report::{Counters, Kept, Losses, Report};
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_BODY, MAX_FRAME, MAX_RAW, MAX_REAL_TIME_FRAME};
use funnelnet_protocol::service::{
    Body, Identity, Key, MAX_REPLY_BODY, Reply, Request, ResetCause, StageError, StoreError,
};
use funnelnet_protocol::{Refusal, can};
use proptest::prelude::*;

/// `largest_config` of wire versions 2 and 3, written down on 2026-11-28.
const GOLDEN_CHECKSUM: u32 = 0x430A_B83A;

fn largest_config() -> NodeConfig {
    let sine = Sine { component: 7, amplitude: 1.0, frequency: 2.0, phase: 3.0 };
    let then = Normalised::Exponential { start: 1.0, end: 1.0, rate: 1.0 };
    NodeConfig {
        id: 127,
        tick_ns: u32::MAX,
        tick_source: TickSource::Sync,
        initial_state: [1.0; MAX_COMPONENTS].into_iter().collect(),
        state_limit: 1.0,
        field: Field {
            slope: [1.0; MAX_MATRIX].into_iter().collect(),
            offset: [1.0; MAX_COMPONENTS].into_iter().collect(),
            sines: (0..MAX_SINES).map(|_| sine).collect(),
        },
        coupling: Coupling::LambdaTracker { eta: 1.0 },
        gain: Gain::Median { eta: 1.0, eps: 1.0 },
        funnel: Funnel {
            factor: 1.0,
            shape: Shape::Schedule { start: 1.0, at_ns: u64::MAX, eps: 1.0, then },
        },
        on_breach: Breach::Reopen { margin: 1.0, rate: 1.0 },
        neighbours: (0..MAX_NEIGHBOURS).map(|_| EdgeConfig { id: 127, weight: 1.0, edges: 126 }).collect(),
        extrapolate_ticks: 255,
        telemetry_every: u32::MAX,
        lost_neighbours: u8::MAX,
        holdover_ns: u64::MAX,
        tuning: Tuning {
            damping: 8.0,
            guard: 0.5,
            round: 100,
            input_limit: 1e9,
            slope_limit: 1e9,
            slow_start: 1_000,
        },
        program: Program::none(),
        limits: Limits { low: -1.0, high: 1.0 },
        heard: HeardLimits::NONE,
        time: TimeRules::NONE,
    }
}

/// The same with limits of what is heard.
fn largest_guarded_config() -> NodeConfig {
    NodeConfig { heard: HeardLimits { limit: 2.0, rate: 3.0, drop_after: 255 }, ..largest_config() }
}

/// The same with rules of time, too, which are the longest.
fn largest_timed_config() -> NodeConfig {
    let masters = [1, 10, 127].into_iter().filter_map(NodeId::new);
    let rules = TimeRules { period_us: 0x0403_0201, jitter_us: 0x0807_0605, ..TimeRules::NONE };
    NodeConfig { time: masters.fold(rules, TimeRules::with_master), ..largest_guarded_config() }
}

fn encode_service(service: &impl Body) -> Vec<u8> {
    let (mut scratch, mut out) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length = serial::encode_service(service, 1, &mut scratch, &mut out).unwrap();
    out[..length].to_vec()
}

/// A frame that owns what it says.
#[derive(Clone, Debug, PartialEq)]
enum Owned {
    RealTime(Message),
    Service(u8, u8, Vec<u8>),
}

fn deframe(bytes: &[u8]) -> Vec<Result<Owned, Refusal>> {
    let own = |frame: Frame<'_>| match frame {
        Frame::RealTime(message) => Owned::RealTime(message),
        Frame::Service { kind, source, body } => Owned::Service(kind, source, body.to_vec()),
    };
    let mut deframer: Deframer = Deframer::new();
    bytes.iter().filter_map(|&byte| deframer.push(byte).map(|frame| frame.map(own))).collect()
}

#[test]
fn largest_configuration_fits_and_little_is_wasted() {
    let mut body = [0; MAX_BODY];
    let request = Request::Configure(largest_timed_config());
    let length = request.encode(&mut body).unwrap();
    assert!(length <= MAX_BODY && length + 32 > MAX_BODY, "{length} of {MAX_BODY}");
    let frames = deframe(&encode_service(&request));
    let [Ok(Owned::Service(kind, 1, body))] = &frames[..] else { panic!("{frames:?}") };
    assert_eq!(Request::decode(*kind, body), Ok(request));
    assert_eq!(Request::decode(*kind, &body[..body.len() - 34]), Err(Refusal::Value));
    assert_eq!(Request::decode(*kind, &body[..body.len() - 1]), Err(Refusal::Length));
    assert_eq!(Request::decode(*kind, &[&body[..], &[0]].concat()), Err(Refusal::Length));
}

#[test]
fn largest_reply_fits_and_little_is_wasted() {
    let most = u32::MAX;
    let counters = Counters {
        ticks: most,
        sent: most,
        accepted: most,
        breaches: most,
        floored: most,
        extrapolated: most,
        neighbours_lost: most,
        sync_gaps: most,
        overruns: most,
        reopened: most,
        weights_differ: most,
        coasted: most,
        saturated: most,
        late: most,
        skipped: most,
        limited: most,
        field_not_finite: most,
        link: Losses { frames: most, bus_errors: most, bus_offs: most, line_errors: most, unsaid: most },
        refused: [most; 14],
        kept: Kept { too_fast: most, barred: most, edges: most },
    };
    let report = Reply::Report(Report { max_ratio: 1.0, counters });
    let mut body = [0; MAX_REPLY_BODY];
    let length = report.encode(&mut body).unwrap();
    assert!(length + 8 > MAX_REPLY_BODY, "{length} of {MAX_REPLY_BODY}");
    assert_eq!(Reply::decode(report.kind(), &body[..length]), Ok(report));
}

/// What was kept away comes last, and only where there is any.
#[test]
fn a_report_ends_with_what_was_kept_away_where_there_is_any() {
    let report =
        |kept| Report { max_ratio: 0.5, counters: Counters { ticks: 300, kept, ..Counters::default() } };
    let bytes = |report: &Report| {
        let mut body = [0; MAX_REPLY_BODY];
        let length = Reply::Report(report.clone()).encode(&mut body).unwrap();
        body[..length].to_vec()
    };
    let (calm, guarded) = (report(Kept::default()), report(Kept { too_fast: 300, barred: 0, edges: 1 }));
    let (short, long) = (bytes(&calm), bytes(&guarded));
    // A ratio, 300 in two bytes, and 10 + 14 + 6 + 5 zeros, as it was written before there was more.
    assert_eq!(short.len(), 4 + 2 + 35);
    assert_eq!(long, [&short[..], &[0xAC, 0x02, 0, 1]].concat());
    for (report, bytes) in [(&calm, &short), (&guarded, &long)] {
        assert_eq!(Reply::decode(0x46, bytes), Ok(Reply::Report(report.clone())));
    }
    for shorter in (0..short.len()).chain(short.len() + 1..long.len()) {
        assert_eq!(Reply::decode(0x46, &long[..shorter]), Err(Refusal::Value), "{shorter}");
    }
    assert_eq!(Reply::decode(0x46, &[&long[..], &[0]].concat()), Err(Refusal::Length));
    // There is one form of it.
    assert_eq!(Reply::decode(0x46, &[&short[..], &[0, 0, 0]].concat()), Err(Refusal::Value));
}

/// Limits of what is heard come last, and only where they are said.
#[test]
fn a_configuration_ends_with_the_limits_of_what_is_heard_where_there_are_any() {
    let encoded = |config: NodeConfig| {
        let mut body = [0; MAX_BODY];
        let length = Request::Stage(config).encode(&mut body).unwrap();
        body[..length].to_vec()
    };
    let (short, long) = (encoded(largest_config()), encoded(largest_guarded_config()));
    assert_eq!(long, [&short[..], &[0, 0, 0, 0x40, 0, 0, 0x40, 0x40, 255]].concat());
    let mut room = NodeConfig::empty();
    // From one to the other, and back.
    for _ in 0..2 {
        assert_eq!((room.read(&long), &room), (Ok(()), &largest_guarded_config()));
        assert_eq!((room.read(&short), &room), (Ok(()), &largest_config()));
    }
    for other in (short.len() + 1..long.len()).chain([long.len() + 1]) {
        let bytes = [&long[..], &[0]].concat();
        assert_eq!(room.read(&bytes[..other]), Err(Refusal::Length), "{other}");
    }
    // There is one form of it, for it has one checksum.
    assert_eq!(room.read(&[&short[..], &[0; 9]].concat()), Err(Refusal::Value));
    assert_eq!(largest_guarded_config().checksum(), NodeConfig::checksum_of(&long));
}

/// Rules of time come after them, and only where they are said.
#[test]
fn a_configuration_ends_with_the_rules_of_time_where_there_are_any() {
    let encoded = |config: NodeConfig| {
        let mut body = [0; MAX_BODY];
        let length = Request::Stage(config).encode(&mut body).unwrap();
        body[..length].to_vec()
    };
    // Nodes 1, 10 and 127, the period, the jitter.
    let rules = [2, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x80, 1, 2, 3, 4, 5, 6, 7, 8];
    let unguarded = NodeConfig { heard: HeardLimits::NONE, ..largest_timed_config() };
    assert_eq!(unguarded.time.masters().collect::<Vec<_>>(), [1, 10, 127]);
    let [bare, guarded, timed, both] =
        [largest_config(), largest_guarded_config(), unguarded.clone(), largest_timed_config()].map(encoded);
    assert_eq!(timed, [&bare[..], &rules].concat());
    assert_eq!(both, [&guarded[..], &rules].concat());
    let mut room = NodeConfig::empty();
    // From each to the next, and back.
    for _ in 0..2 {
        for (bytes, config) in [
            (&both, largest_timed_config()),
            (&guarded, largest_guarded_config()),
            (&timed, unguarded.clone()),
            (&bare, largest_config()),
        ] {
            assert_eq!((room.read(bytes), &room), (Ok(()), &config));
        }
    }
    let whole = [bare.len(), guarded.len(), timed.len(), both.len()];
    for other in (bare.len()..both.len() + 2).filter(|length| !whole.contains(length)) {
        let bytes = [&both[..], &[0]].concat();
        assert_eq!(room.read(&bytes[..other]), Err(Refusal::Length), "{other}");
    }
    // There is one form of it, too.
    assert_eq!(room.read(&[&bare[..], &[0; 24]].concat()), Err(Refusal::Value));
    assert_eq!(room.read(&[&guarded[..], &[0; 24]].concat()), Err(Refusal::Value));
    assert_eq!(largest_timed_config().checksum(), NodeConfig::checksum_of(&both));
}

/// Append-only: a variant keeps its number, an answer its kind and its length.
#[test]
fn storing_has_these_bytes() {
    let requests = [(Request::Store, 0x47), (Request::Erase, 0x49)];
    for (request, kind) in requests {
        assert_eq!((request.kind(), request.encode(&mut [])), (kind, Some(0)));
        assert_eq!(Request::decode(kind, &[]), Ok(request));
        assert_eq!(Request::decode(kind, &[0]), Err(Refusal::Length));
    }
    let key = Request::Key(Key([7; 16]));
    assert_eq!((key.kind(), key.encode(&mut [0; 16])), (0x4D, Some(16)));
    assert_eq!(Request::decode(0x4D, &[7; 16]), Ok(key));
    for wrong in [&[7; 15][..], &[7; 17], &[]] {
        assert_eq!(Request::decode(0x4D, wrong), Err(Refusal::Length));
    }
    let answers: [(Reply, u8, &[u8]); 17] = [
        (Reply::Stored(Ok(u32::MAX)), 0x48, &[0, 0xFF, 0xFF, 0xFF, 0xFF, 0x0F]),
        (Reply::Stored(Err(StoreError::Running)), 0x48, &[1, 0]),
        (Reply::Stored(Err(StoreError::Blank)), 0x48, &[1, 1]),
        (Reply::Stored(Err(StoreError::Absent)), 0x48, &[1, 2]),
        (Reply::Stored(Err(StoreError::Failed)), 0x48, &[1, 3]),
        (Reply::Erased(Ok(())), 0x4A, &[0]),
        (Reply::Erased(Err(StoreError::Failed)), 0x4A, &[1, 3]),
        (Reply::Staged(Ok(0x1234_5678)), 0x4C, &[0, 0xF8, 0xAC, 0xD1, 0x91, 0x01]),
        (Reply::Staged(Err(StageError::Config(ConfigError::Malformed))), 0x4C, &[1, 0, 4]),
        (Reply::Staged(Err(StageError::Store(StoreError::Running))), 0x4C, &[1, 1, 0]),
        (Reply::Staged(Err(StageError::Store(StoreError::Absent))), 0x4C, &[1, 1, 2]),
        (Reply::Stored(Err(StoreError::Busy)), 0x48, &[1, 4]),
        (Reply::Staged(Err(StageError::Store(StoreError::Busy))), 0x4C, &[1, 1, 4]),
        (Reply::Configured(Err(ConfigError::Busy)), 0x43, &[1, 7]),
        (Reply::Configured(Err(ConfigError::TimeOfTicks)), 0x43, &[1, 9]),
        (Reply::Keyed(Ok(300)), 0x4E, &[0, 0xAC, 0x02]),
        (Reply::Keyed(Err(StoreError::Failed)), 0x4E, &[1, 3]),
    ];
    for (answer, kind, bytes) in answers {
        let mut body = [0; MAX_REPLY_BODY];
        let length = answer.encode(&mut body).unwrap();
        assert_eq!((answer.kind(), &body[..length]), (kind, bytes));
        assert_eq!(Reply::decode(kind, bytes), Ok(answer));
        assert_eq!(Reply::decode(kind, &[bytes, &[0]].concat()), Err(Refusal::Length));
    }
}

#[test]
fn an_identity_ends_with_checksum_and_key() {
    let identity = Identity {
        wire_version: 1,
        firmware: [0, 1, 0],
        id: 5,
        uid: 300,
        reset: ResetCause::Watchdog,
        starts: 2,
        checksum: 0x1234_5678,
        has_key: true,
    };
    let bytes = [1, 0, 1, 0, 5, 0xAC, 0x02, 4, 2, 0xF8, 0xAC, 0xD1, 0x91, 0x01, 1];
    let mut body = [0; MAX_REPLY_BODY];
    let length = Reply::Identity(identity).encode(&mut body).unwrap();
    assert_eq!(&body[..length], bytes);
    assert_eq!(Reply::decode(0x41, &bytes), Ok(Reply::Identity(identity)));
}

/// A host computes it from the bytes that it sends, by any CRC-32.
#[test]
fn the_checksum_of_a_configuration_is_that_of_its_bytes() {
    let config = largest_config();
    let mut body = [0; MAX_BODY];
    let length = Request::Stage(config.clone()).encode(&mut body).unwrap();
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&body[..length]);
    assert_eq!((config.checksum(), crc), (crc, GOLDEN_CHECKSUM));
    assert_ne!(NodeConfig { id: 126, ..config.clone() }.checksum(), crc);
    let Ok(Request::Stage(back)) = Request::decode(0x4B, &body[..length]) else { panic!() };
    assert_eq!((&back, back.checksum()), (&config, crc));
}

/// A node reads each where the one before it was.
#[test]
fn a_configuration_is_read_over_another_and_refused_at_any_other_length() {
    let small = NodeConfig {
        initial_state: [2.0].into_iter().collect(),
        field: Field::scalar(0.5, 0.25, []),
        neighbours: [EdgeConfig { id: 1, weight: 0.5, edges: 2 }].into_iter().collect(),
        on_breach: Breach::Stop,
        lost_neighbours: 0,
        holdover_ns: 0,
        tuning: Tuning::default(),
        limits: Limits::default(),
        ..largest_config()
    };
    let mut body = [0; MAX_BODY];
    let mut room = largest_config();
    let with_program = NodeConfig {
        program: Program {
            code: [0x20, 0x40, 0x06].into_iter().collect(),
            constants: [3.0].into_iter().collect(),
        },
        ..small.clone()
    };
    for config in [small.clone(), largest_config(), with_program, small.clone()] {
        let length = Request::Stage(config.clone()).encode(&mut body).unwrap();
        for shorter in 0..length {
            assert_eq!(room.read(&body[..shorter]), Err(Refusal::Value), "{shorter} of {length}");
        }
        assert_eq!(room.read(&[&body[..length], &[0]].concat()), Err(Refusal::Length));
        assert_eq!((room.read(&body[..length]), &room), (Ok(()), &config));
    }
    // As it was written before its last fields, which are 0 or empty: of one byte, one byte, eighteen and
    // ten.
    let length = Request::Stage(small.clone()).encode(&mut body).unwrap();
    for newer in [10, 28, 30] {
        assert_eq!((room.read_older(&body[..length - newer], newer), &room), (Ok(()), &small));
        for missing in [0, newer - 1, newer + 1] {
            let refused = room.read_older(&body[..length - newer], missing);
            assert_eq!(refused, Err(Refusal::Value), "{missing} of {newer}");
        }
    }
}

#[test]
fn a_list_that_is_too_long_is_refused() {
    let mut body = [0; MAX_BODY];
    let config =
        NodeConfig { initial_state: [1.0; MAX_COMPONENTS].into_iter().collect(), ..NodeConfig::empty() };
    let length = Request::Stage(config).encode(&mut body).unwrap();
    // The number of components comes after id, period and tick source.
    assert_eq!(usize::from(body[3]), MAX_COMPONENTS);
    body[3] += 1;
    let longer = [&body[..4], &[0; 4], &body[4..length]].concat();
    assert_eq!(NodeConfig::empty().read(&longer), Err(Refusal::Value));
}

#[test]
fn a_key_does_not_show_in_a_log() {
    assert_eq!(format!("{:?}", Request::<NodeConfig>::Key(Key([0x5A; 16]))), "Key(Key(..))");
}

#[test]
fn an_oversized_frame_is_dropped_whole() {
    // A long run of garbage whose tail is a valid frame must not yield that frame.
    let valid = serial::encode(&Message::State {
        source: NodeId::new(5).unwrap(),
        component: Component::FIRST,
        tick: TickStamp::full(7),
        x: 1.0,
    });
    let mut bytes = vec![1; MAX_FRAME];
    bytes.extend_from_slice(&valid);
    bytes.extend_from_slice(&valid);
    let frames = deframe(&bytes);
    assert_eq!(frames.len(), 2);
    assert_eq!(frames[0], Err(Refusal::Overflow));
    assert!(frames[1].is_ok());
}

#[test]
fn a_truncated_service_frame_is_refused_at_every_length() {
    let whole = encode_service(&Request::Configure(largest_config()));
    for length in 1..whole.len() - 1 {
        let mut bytes = whole[..length].to_vec();
        bytes.push(0);
        assert!(deframe(&bytes).iter().all(Result::is_err), "{length}");
    }
}

#[test]
fn not_a_number_is_refused() {
    for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let [x0, x1, x2, x3] = x.to_le_bytes();
        assert_eq!(can::decode(0x185, &[x0, x1, x2, x3, 0]), Err(Refusal::NotFinite));
    }
}

proptest! {
    #[test]
    fn any_can_frame_gives_a_message_or_a_reason(id: u16, data in proptest::collection::vec(any::<u8>(), 0..=8)) {
        if let Ok(message) = can::decode(id, &data) {
            let again = can::encode(&message);
            // Everything but the reserved upper id bits survives: a message has one form only.
            prop_assert_eq!((again.id(), again.data()), (id & 0x7FF, data.as_slice()));
        }
    }

    #[test]
    fn any_bytes_give_frames_or_reasons(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        for frame in deframe(&bytes).into_iter().flatten() {
            if let Owned::RealTime(message) = frame {
                prop_assert!(serial::encode(&message).len() <= MAX_REAL_TIME_FRAME);
            }
        }
    }

    #[test]
    fn any_serial_frame_gives_a_message_or_a_reason(
        function in prop_oneof![0u8..=3, Just(12)], from: u8, body in proptest::collection::vec(0u8..4, 4..=6)
    ) {
        let raw = [&[serial::REAL_TIME | function, from], body.as_slice()].concat();
        let crc = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&raw);
        let whole = [raw.as_slice(), &crc.to_be_bytes()].concat();
        let mut frame = vec![0; 32];
        let length = cobs::encode(&whole, &mut frame);
        frame.truncate(length + 1);
        if let [Ok(Owned::RealTime(message))] = &deframe(&frame)[..] {
            // A message has one form only.
            prop_assert_eq!(serial::encode(message).to_vec(), frame);
        }
    }

    #[test]
    fn a_flipped_bit_never_passes(node in 1u8..=127, tick: u32, x in -1e6f32..1e6, bit in 0usize..80) {
        let message = Message::State {
            source: NodeId::new(node).unwrap(), component: Component::FIRST, tick: TickStamp::full(tick), x,
        };
        let mut bytes = serial::encode(&message).to_vec();
        let bit = bit % ((bytes.len() - 1) * 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        for frame in deframe(&bytes) {
            prop_assert!(frame.is_err(), "{:?}", frame);
        }
    }

    #[test]
    fn states_survive_the_serial_link(node in 1u8..=127, k in 0u8..8, tick: u32, x in proptest::num::f32::NORMAL) {
        let source = NodeId::new(node).unwrap();
        let component = Component::new(k).unwrap();
        let sent = Message::State { source, component, tick: TickStamp::full(tick), x };
        let got = Message::State { source, component, tick: TickStamp::low(tick, 16), x };
        prop_assert_eq!(deframe(&serial::encode(&sent)), vec![Ok(Owned::RealTime(got))]);
    }

    #[test]
    fn ticks_are_rebuilt_inside_the_window(own: u32, offset in -8i32..=2) {
        let tick = own.wrapping_add_signed(offset);
        prop_assert_eq!(TickStamp::low(tick, 8).rebuild(own, 8, 2), Some(tick));
        prop_assert_eq!(TickStamp::low(own.wrapping_add(3), 8).rebuild(own, 8, 2), None);
        prop_assert_eq!(TickStamp::low(own.wrapping_sub(9), 8).rebuild(own, 8, 2), None);
    }
}
