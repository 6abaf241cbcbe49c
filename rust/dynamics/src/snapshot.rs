use proact_types::Pose;
use serde::{Deserialize, Serialize};
use std::fmt::{Debug, Write};

/// State of an [`RigidBodyPlant`](crate::OdePlant) at a tick. A text format must keep every bit of a number, as JSON does
/// with `serde_json`'s `float_roundtrip`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Of arm, scene and options.
    pub(crate) fingerprint: u64,
    /// As the command said it: ODE's own is normalized.
    pub(crate) world_from_base: Pose,
    /// In the order of `cpp/dynamics/src/snapshot.cpp`.
    pub(crate) numbers: Vec<f64>,
}

/// FNV-1a over the text of what is given.
pub(crate) fn fingerprint(things: &impl Debug) -> u64 {
    struct Hash(u64);
    impl Write for Hash {
        fn write_str(&mut self, text: &str) -> std::fmt::Result {
            for byte in text.bytes() {
                self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
            }
            Ok(())
        }
    }
    let mut hash = Hash(0xcbf2_9ce4_8422_2325);
    write!(hash, "{things:?}").expect("hashing never fails");
    hash.0
}
