//! An update through the app of a node: from the bytes of its line to its storage, and back.
#![cfg(feature = "update")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod bench;

use bench::{Line, MS, Said, Time, config, start};
use funnelnet_app::link::serial::Serial;
use funnelnet_app::storage::{Absent, Storage};
use funnelnet_app::watchdog;
use funnelnet_app::{App, Platform};
use funnelnet_node::{Session, Task};
use funnelnet_plant::Virtual;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::{Identity, Reply, StoreError};
use funnelnet_protocol::update::{self, Request, UpdateError};
use std::cell::{Cell, RefCell};
use std::pin::pin;

/// What a storage was asked.
#[derive(Default)]
struct Asked {
    requests: RefCell<Vec<(Request, bool)>>,
    completed: Cell<u32>,
    restarted: Cell<bool>,
}

/// Restarts where it is told to, and answers everything else by a refusal.
struct Played<'a>(&'a Asked);

impl Storage for Played<'_> {
    async fn load(&mut self, room: &mut Option<NodeConfig>) {
        *room = Some(config(1));
    }

    async fn has_key(&mut self) -> bool {
        false
    }

    async fn perform(&mut self, _: Task<'_>) -> Result<u32, StoreError> {
        Err(StoreError::Absent)
    }

    async fn update(&mut self, request: &Request, is_running: bool) -> update::Reply {
        self.0.requests.borrow_mut().push((request.clone(), is_running));
        match request {
            Request::Restart if !is_running => update::Reply::Restarts(Ok(())),
            request => request.refused(UpdateError::Running),
        }
    }

    async fn note_ticks(&mut self, completed: u32) {
        self.0.completed.set(completed);
    }

    fn wants_restart(&self) -> bool {
        let last = self.0.requests.borrow().last().cloned();
        matches!(last, Some((Request::Restart, false)))
    }

    fn restart(&mut self) {
        self.0.restarted.set(true);
    }
}

async fn node(time: &Time, line: &Line<'_>, mut storage: impl Storage) {
    let mut session = Session::new(Identity::default());
    let mut link = Serial::new(line);
    let platform = Platform { watchdog: watchdog::Absent, clock: time, log: () };
    App::new(&mut session, &mut link, &mut storage, Virtual, platform).run().await
}

fn answers(line: &Line<'_>) -> Vec<update::Reply> {
    let heard = line.heard().into_iter();
    heard
        .filter_map(|said| if let Said::Reply(Reply::Update(reply)) = said { Some(reply) } else { None })
        .collect()
}

#[test]
fn a_request_reaches_the_storage_its_answer_the_line_and_then_the_node_restarts() {
    let (time, asked) = (Time::default(), Asked::default());
    let line = Line::new(&time);
    let mut node = pin!(node(&time, &line, Played(&asked)));
    line.request(&Request::Check);
    time.run(node.as_mut(), MS);
    assert_eq!(answers(&line), [update::Reply::Checked(Err(UpdateError::Running))]);
    line.request(&Request::Restart);
    time.run(node.as_mut(), 2 * MS);
    assert_eq!(answers(&line), [update::Reply::Restarts(Ok(()))]);
    assert!(!asked.restarted.get(), "the answer has time to leave");
    time.run(node.as_mut(), 200 * MS);
    assert!(asked.restarted.get());
}

#[test]
fn a_node_that_runs_is_said_to_and_its_ticks_are_told() {
    let (time, asked) = (Time::default(), Asked::default());
    let line = Line::new(&time);
    let mut node = pin!(node(&time, &line, Played(&asked)));
    time.run(node.as_mut(), MS);
    assert_eq!(asked.completed.get(), 0);
    line.tell(&start());
    time.run(node.as_mut(), 40 * MS);
    line.request(&Request::Restart);
    time.run(node.as_mut(), 60 * MS);
    assert_eq!(*asked.requests.borrow(), [(Request::Restart, true)]);
    assert_eq!(answers(&line), [update::Reply::Restarts(Err(UpdateError::Running))]);
    assert!(!asked.restarted.get());
    assert!(asked.completed.get() > 1, "{}", asked.completed.get());
}

#[test]
fn a_storage_that_takes_no_programs_says_so() {
    let time = Time::default();
    let line = Line::new(&time);
    let mut node = pin!(node(&time, &line, Absent));
    line.request(&Request::Swap);
    time.run(node.as_mut(), MS);
    assert_eq!(answers(&line), [update::Reply::Restarts(Err(UpdateError::Absent))]);
}
