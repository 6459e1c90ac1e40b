//! Bus models: what happens to a frame between its sender and its receivers.

pub mod ideal;
