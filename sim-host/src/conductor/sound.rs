//! What a line sounds like on which no node answers: an echo, a computer's console, a program that prints, or
//! another bit rate.

use crate::printable::printable;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::serial::{Deframer, Frame};
use funnelnet_protocol::service::{Body as _, Request};

/// Bytes of a line that are kept: the last ones.
const KEPT: usize = 512;
/// Fewer bytes say nothing.
const ENOUGH: usize = 16;
/// More bytes than the longest frame has, and none of them a zero.
const ENDLESS: usize = 200;
/// Characters of a text that are quoted: the last ones.
const QUOTED: usize = 60;

/// The last bytes that were heard on a line.
#[derive(Debug, Default)]
pub struct Sound {
    heard: Vec<u8>,
}

impl Sound {
    /// Takes what was read.
    pub fn hear(&mut self, bytes: &[u8]) {
        self.heard.extend_from_slice(bytes);
        let surplus = self.heard.len().saturating_sub(KEPT);
        self.heard.drain(..surplus);
    }

    /// What it is, as a sentence; `None` where it sounds like a node, or like nothing.
    #[must_use]
    pub fn words(&self) -> Option<String> {
        words(&self.heard)
    }
}

/// What bytes that were heard on a line are, if they are not those of a node.
#[must_use]
pub fn words(heard: &[u8]) -> Option<String> {
    if is_echo(heard) {
        return Some(
            "the line echoes what is sent to it: TX may be joined to RX, or a terminal is at its other end, not a node"
                .to_owned(),
        );
    }
    if let Some(text) = text(heard) {
        let quoted = last(&text);
        let lower = text.to_ascii_lowercase();
        let is_login = ["login:", "password:", "username:"].iter().any(|prompt| lower.contains(prompt));
        return Some(if is_login {
            format!("a login prompt is on the line, the console of a computer and not a node: \"{quoted}\"")
        } else {
            format!(
                "text is on the line, which no node sends: \"{quoted}\"; another program or a boot loader may run on the board"
            )
        });
    }
    if heard.len() >= ENOUGH && heard.iter().all(|&byte| byte == 0) {
        return Some(
            "nothing but zeros is on the line, as on one that is held low: is it connected, and is the board on?"
                .to_owned(),
        );
    }
    let is_endless = heard.len() >= ENDLESS && !heard.contains(&0);
    is_endless.then(|| {
        format!(
            "the last {} bytes on the line have no zero, with which every frame ends: its bit rate may be another one, or the board runs another program",
            heard.len()
        )
    })
}

/// Whether this program hears what only it says, as it is or as a terminal shows it.
fn is_echo(heard: &[u8]) -> bool {
    let mut deframer: Deframer = Deframer::new();
    let mut is_own = |&byte: &u8| match deframer.push(byte) {
        Some(Ok(Frame::Service { kind, body, .. })) => Request::decode(kind, body).is_ok(),
        Some(Ok(Frame::RealTime(message))) => {
            matches!(message, Message::Ctrl { .. } | Message::Sync { source: None, .. })
        }
        Some(Err(_)) | None => false,
    };
    // A terminal shows a zero byte, with which each frame begins and ends, as ^@.
    heard.iter().any(&mut is_own) || heard.windows(2).filter(|pair| pair == b"^@").count() >= 2
}

/// The text that the bytes are, where nearly all of them can be read. A text has blanks; a bit pattern may be
/// a letter.
fn text(heard: &[u8]) -> Option<String> {
    let readable = |byte: &&u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n' | 0x1b);
    let is_text = heard.len() >= ENOUGH
        && !heard.contains(&0)
        && heard.iter().any(u8::is_ascii_whitespace)
        && heard.iter().filter(readable).count() * 10 >= heard.len() * 9;
    is_text.then(|| String::from_utf8_lossy(heard).into_owned())
}

/// The end of a text on one line, without what a terminal would obey.
fn last(text: &str) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let from = words.char_indices().rev().nth(QUOTED - 1).map_or(0, |(at, _)| at);
    printable(&words[from..]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use funnelnet_protocol::NodeId;
    use funnelnet_protocol::message::{Command, Component, Target, TickStamp};
    use funnelnet_protocol::serial::{self, HOST, MAX_FRAME, MAX_RAW};
    use funnelnet_protocol::service::{Body, Identity, Reply};

    fn service(body: &impl Body, source: u8) -> Vec<u8> {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        let length = serial::encode_service(body, source, &mut scratch, &mut frame).unwrap();
        frame[..length].to_vec()
    }

    fn said(heard: &[u8], word: &str) {
        let words = words(heard).unwrap_or_else(|| panic!("nothing is said of {heard:?}"));
        assert!(words.contains(word), "{words}");
    }

    #[test]
    fn an_echo_is_told_whether_it_is_whole_or_shown_by_a_terminal() {
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        said(&service(&Request::Hello, HOST), "echoes");
        said(&serial::encode(&start), "echoes");
        said(b"login: ^@^A^B%^@^M\r\nPassword: ", "echoes");
        // Behind noise, too.
        said(&[&[0xA5; 30][..], &[0], &service(&Request::Hello, HOST)].concat(), "echoes");
    }

    #[test]
    fn a_login_prompt_and_other_text_are_told_and_quoted() {
        said(b"\r\nDebian GNU/Linux 12 \x1b[1mpi\x1b[0m ttyS0\r\n\r\npi login: ", "a login prompt");
        said(b"\r\nDebian GNU/Linux 12 pi ttyS0\r\n\r\npi login: ", "12 pi ttyS0 pi login:\"");
        said(
            b"U-Boot 2024.01\r\nHit any key to stop autoboot: 3",
            "text is on the line, which no node sends",
        );
        let quoted = words(b"temperature \x1b[31m21.5\x1b[0m\n").unwrap();
        assert!(!quoted.contains('\u{1b}'), "{quoted:?}");
    }

    #[test]
    fn bytes_without_an_end_and_ends_without_bytes_are_told() {
        said(&[0; 300], "nothing but zeros");
        said(&[0x55; 300], "no zero");
        let mut sound = Sound::default();
        (0..1000).for_each(|_| sound.hear(&[0xA5; 100]));
        assert_eq!(sound.heard.len(), KEPT);
        assert!(sound.words().unwrap().contains("the last 512 bytes"));
    }

    #[test]
    fn what_a_node_says_and_what_says_nothing_is_told_of_nobody() {
        let state = |x| Message::State {
            source: NodeId::new(2).unwrap(),
            component: Component::FIRST,
            tick: TickStamp::full(7),
            x,
        };
        let states: Vec<u8> = (0..100).flat_map(|k| serial::encode(&state(k as f32)).to_vec()).collect();
        // No node has an id before it is given one, and says so by 0: what the host is called, too.
        let identity = service(&Reply::Identity(Identity { uid: 9, ..Identity::default() }), HOST);
        for heard in [&states[..], &identity, &[], &[0; 8], &[0x55; 8], b"short"] {
            assert_eq!(words(heard), None, "{heard:?}");
        }
    }
}
