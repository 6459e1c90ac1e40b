//! What has come of a program, and what may come next: without flash, bytes or time.

use funnelnet_protocol::update::{BLOCK_UNIT, Block, Checksum, Image, MAX_BLOCK, UpdateError};

/// What to do with a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Write it, and say so by [`Transfer::written`].
    Write,
    /// It is there already: its answer was lost.
    Repeated,
}

/// The transfer of one program.
#[derive(Clone, Debug, Default)]
pub struct Transfer {
    image: Option<Image>,
    received: u32,
    /// Offset and checksum of the block that was written last.
    last: Option<(u32, u32)>,
    is_checked: bool,
    refused: u32,
    repeated: u32,
}

impl Transfer {
    /// Nothing has come.
    pub const fn new() -> Self {
        Self { image: None, received: 0, last: None, is_checked: false, refused: 0, repeated: 0 }
    }

    /// Takes the announcement of a program, for a board with this number and so much room (bytes). What has
    /// come of another one is forgotten.
    ///
    /// # Errors
    /// `Board`, `Length`. What has come stays then.
    pub fn begin(&mut self, image: Image, board: u32, room: u32) -> Result<(), UpdateError> {
        if image.board != board {
            return Err(UpdateError::Board { own: board });
        }
        if image.length == 0 || image.length > room {
            return Err(UpdateError::Length { room });
        }
        self.forget();
        self.image = Some(image);
        Ok(())
    }

    /// Looks at a block.
    ///
    /// # Errors
    /// `NotBegun`, `Block`, `Order`; each is counted.
    pub fn block(&mut self, block: &Block) -> Result<Step, UpdateError> {
        let step = self.judge(block);
        match step {
            Ok(Step::Write) => {}
            Ok(Step::Repeated) => self.repeated = self.repeated.saturating_add(1),
            Err(_) => self.refused = self.refused.saturating_add(1),
        }
        step
    }

    fn judge(&self, block: &Block) -> Result<Step, UpdateError> {
        let image = self.image.ok_or(UpdateError::NotBegun)?;
        if Checksum::of(&block.bytes) != block.crc {
            return Err(UpdateError::Block);
        }
        if self.last == Some((block.offset, block.crc)) {
            return Ok(Step::Repeated);
        }
        if block.offset != self.received || self.received >= image.length {
            return Err(UpdateError::Order { next: self.received });
        }
        let length = block.bytes.len() as u32;
        let left = image.length.saturating_sub(self.received);
        if length != left.min(BLOCK_UNIT) {
            return Err(UpdateError::Block);
        }
        Ok(Step::Write)
    }

    /// Takes note that the block is in the flash.
    pub fn written(&mut self, block: &Block) {
        self.received = self.received.saturating_add(block.bytes.len().min(MAX_BLOCK) as u32);
        self.last = Some((block.offset, block.crc));
    }

    /// The program, once all of it has come.
    ///
    /// # Errors
    /// `NotBegun`, `Incomplete`.
    pub fn complete(&self) -> Result<Image, UpdateError> {
        let image = self.image.ok_or(UpdateError::NotBegun)?;
        match self.received == image.length {
            true => Ok(image),
            false => Err(UpdateError::Incomplete { received: self.received }),
        }
    }

    /// Takes the checksum of what is in the flash.
    ///
    /// # Errors
    /// `NotBegun`, `Incomplete`; `Checksum` where it is not the announced one: all has to come again then.
    pub fn check(&mut self, found: u32) -> Result<(), UpdateError> {
        let image = self.complete()?;
        if image.crc != found {
            self.forget();
            return Err(UpdateError::Checksum { found });
        }
        self.is_checked = true;
        Ok(())
    }

    /// Forgets what has come; the counters stay.
    pub fn forget(&mut self) {
        *self = Self { refused: self.refused, repeated: self.repeated, ..Self::new() };
    }

    /// Bytes that have come.
    pub fn received(&self) -> u32 {
        self.received
    }

    /// Whether these are all, and what was announced.
    pub fn is_checked(&self) -> bool {
        self.is_checked
    }

    /// Blocks that were refused, and blocks that came again.
    pub fn counters(&self) -> (u32, u32) {
        (self.refused, self.repeated)
    }
}
