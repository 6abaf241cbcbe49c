//! Thalmic's Myo armband, which most public recordings were made with.
//!
//! [`protocol`] is the bytes, [`MyoSimulator`] the other side without clock and socket, [`Myo`] drives an armband over any
//! [`crate::gforce::GattLink`]: a socket to the simulator, or a radio (feature `ble`).
//!
//! No armband was at hand when this was written: the bytes are those of the maker's published header.

mod driver;
mod numbering;
pub mod protocol;
mod simulator;

pub use driver::Myo;
pub use protocol::{MyoCommand, MyoEmgMode, MyoVibration};
pub use simulator::{MyoSimulator, MyoSimulatorOptions};
