//! What a node does for a new program: it takes, checks and marks it, and confirms the one that runs.

use embassy_boot::{FirmwareState, State};
use embedded_storage_async::nor_flash::NorFlash;
use funnelnet_protocol::update::{Block, Checksum, MAX_BLOCK, Reply, Request, Status, UpdateError};

use crate::transfer::{Step, Transfer};
use crate::wide::Window;
use crate::{Regions, TRIAL_TICKS, WORD};

/// Longest write of any flash that is known here, bytes.
const MAX_WRITE: usize = MAX_BLOCK;

/// Most ticks that a node completes between two looks at it.
const MOST_AT_ONCE: u32 = 4;

/// Programs of a node, in regions of a flash that it is handed each time: the storage owns it.
pub struct Updater {
    regions: Regions,
    board: u32,
    transfer: Transfer,
    /// Ticks that the running program still has to complete; `None` where it is not on trial, or where
    /// nobody has [looked](Self::look) yet.
    ticks_left: Option<u32>,
    /// Completed ticks, as told last.
    completed: u32,
    restarts: bool,
}

impl Updater {
    /// For programs of the board with this number ([`funnelnet_protocol::update::board_number`]).
    pub const fn new(regions: Regions, board: u32) -> Self {
        Self { regions, board, transfer: Transfer::new(), ticks_left: None, completed: 0, restarts: false }
    }

    /// Finds whether the running program is on trial. A flash that cannot be read counts as one without a
    /// program on trial.
    pub async fn look<S: NorFlash>(&mut self, flash: &mut S) {
        self.ticks_left = matches!(self.is_on_trial(flash).await, Ok(true)).then_some(TRIAL_TICKS);
    }

    /// Answers a request. A node that runs only says how it is.
    pub async fn answer<S: NorFlash>(&mut self, flash: &mut S, request: &Request, is_running: bool) -> Reply {
        if !self.regions.suit(S::ERASE_SIZE as u32) {
            return request.refused(UpdateError::Absent);
        }
        match request {
            Request::Status { length } => Reply::Status(self.status(flash, *length, is_running).await),
            _ if is_running => request.refused(UpdateError::Running),
            Request::Begin(image) => Reply::Begun(match self.settle(flash).await {
                Ok(()) => self.transfer.begin(*image, self.board, self.regions.room()),
                Err(why) => Err(why),
            }),
            Request::Block(block) => Reply::Written(self.take(flash, block).await),
            Request::Check => Reply::Checked(self.check(flash).await),
            Request::Swap => Reply::Restarts(self.swap(flash).await),
            Request::Restart => {
                self.restarts = true;
                Reply::Restarts(Ok(()))
            }
            _ => request.refused(UpdateError::Absent),
        }
    }

    /// Whether the node is to restart, now that the answer is said.
    pub fn restarts(&self) -> bool {
        self.restarts
    }

    /// Takes the number of ticks that the node has completed since it was made; confirms a program that has
    /// completed enough of them. That is one short write and no erase, so that it may be done while it runs.
    pub async fn note_ticks<S: NorFlash>(&mut self, flash: &mut S, completed: u32) {
        // A node that was configured anew counts anew. One that is started at a later tick has not completed
        // those before it.
        let more = completed.checked_sub(self.completed).unwrap_or(completed).min(MOST_AT_ONCE);
        self.completed = completed;
        let Some(left) = self.ticks_left else { return };
        let left = left.saturating_sub(more);
        if left > 0 {
            self.ticks_left = Some(left);
        } else if self.confirm(flash).await.is_ok() {
            self.ticks_left = None;
        } else {
            // Again at the next tick.
            self.ticks_left = Some(1);
        }
    }

    async fn status<S: NorFlash>(&mut self, flash: &mut S, length: u32, is_running: bool) -> Status {
        let (refused, repeated) = self.transfer.counters();
        let length = length.min(self.regions.room());
        // Reading it all would hold up a node that runs.
        let crc = match is_running {
            true => 0,
            false => sum(flash, self.regions.active.start, length).await.unwrap_or(0),
        };
        Status {
            board: self.board,
            room: self.regions.room(),
            crc,
            on_trial: self.ticks_left.is_some(),
            ticks_left: self.ticks_left.unwrap_or(0),
            received: self.transfer.received(),
            is_checked: self.transfer.is_checked(),
            refused,
            repeated,
        }
    }

    /// Writes a block; the page that begins with it is erased first.
    async fn take<S: NorFlash>(&mut self, flash: &mut S, block: &Block) -> Result<u32, UpdateError> {
        if self.transfer.block(block)? == Step::Write {
            self.write(flash, block).await.map_err(|_| UpdateError::Flash)?;
            self.transfer.written(block);
        }
        Ok(self.transfer.received())
    }

    async fn write<S: NorFlash>(&self, flash: &mut S, block: &Block) -> Result<(), S::Error> {
        let at = self.regions.spare.start.saturating_add(block.offset);
        let page = S::ERASE_SIZE as u32;
        if at.is_multiple_of(page) {
            flash.erase(at, at.saturating_add(page)).await?;
        }
        let mut bytes = [0xFF; MAX_WRITE];
        bytes.iter_mut().zip(&block.bytes).for_each(|(to, from)| *to = *from);
        let length = block.bytes.len().next_multiple_of(S::WRITE_SIZE);
        flash.write(at, bytes.get(..length).unwrap_or(&bytes)).await
    }

    async fn check<S: NorFlash>(&mut self, flash: &mut S) -> Result<(), UpdateError> {
        let image = self.transfer.complete()?;
        let found = sum(flash, self.regions.spare.start, image.length).await;
        self.transfer.check(found.map_err(|_| UpdateError::Flash)?)
    }

    /// Has the boot loader swap at the next start, and the node restart.
    async fn swap<S: NorFlash>(&mut self, flash: &mut S) -> Result<(), UpdateError> {
        if !self.transfer.is_checked() {
            return Err(UpdateError::NotChecked);
        }
        let mut word = [0; WORD];
        let mut state = FirmwareState::new(self.state(flash), &mut word);
        state.mark_updated().await.map_err(|_| UpdateError::Flash)?;
        self.restarts = true;
        Ok(())
    }

    /// Nothing may be written over the program before while the one that runs is on trial. One that has been
    /// confirmed while it ran is marked as booted: that takes an erase.
    async fn settle<S: NorFlash>(&mut self, flash: &mut S) -> Result<(), UpdateError> {
        if self.is_on_trial(flash).await? {
            return Err(UpdateError::OnTrial);
        }
        let mut word = [0; WORD];
        let mut state = FirmwareState::new(self.state(flash), &mut word);
        match state.get_state().await {
            Ok(State::Swap) => state.mark_booted().await.map_err(|_| UpdateError::Flash),
            Ok(_) => Ok(()),
            Err(_) => Err(UpdateError::Flash),
        }
    }

    /// The mark of `embassy-boot` that its progress does not count any more: the first step of
    /// `mark_booted`, after which no start goes back.
    async fn confirm<S: NorFlash>(&mut self, flash: &mut S) -> Result<(), UpdateError> {
        let mut state = self.state(flash);
        state.write(WORD as u32, &[0; WORD]).await.map_err(|_| UpdateError::Flash)
    }

    async fn is_on_trial<S: NorFlash>(&mut self, flash: &mut S) -> Result<bool, UpdateError> {
        use embedded_storage_async::nor_flash::ReadNorFlash;
        let mut state = self.state(flash);
        let (mut magic, mut validity) = ([0; WORD], [0; WORD]);
        state.read(0, &mut magic).await.map_err(|_| UpdateError::Flash)?;
        state.read(WORD as u32, &mut validity).await.map_err(|_| UpdateError::Flash)?;
        Ok(State::from(magic) == State::Swap && validity == [0xFF; WORD])
    }

    fn state<'a, S>(&self, flash: &'a mut S) -> Window<'a, S> {
        let part = &self.regions.state;
        Window { flash, start: part.start, length: part.end.saturating_sub(part.start) }
    }
}

/// Checksum of a part of the flash.
async fn sum<S: NorFlash>(flash: &mut S, start: u32, length: u32) -> Result<u32, S::Error> {
    let mut sum = Checksum::new();
    let mut bytes = [0; MAX_BLOCK];
    let mut done = 0;
    while done < length {
        flash.read(start.saturating_add(done), &mut bytes).await?;
        let part = (length - done).min(MAX_BLOCK as u32);
        sum.take(bytes.get(..part as usize).unwrap_or(&bytes));
        done += part;
    }
    Ok(sum.value())
}
