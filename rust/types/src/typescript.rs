//! What values of nalgebra look like in JSON, for the TypeScript of the page: [`ts_rs`] does not know them.

/// A rigid transform, metres.
#[derive(Debug, ts_rs::TS)]
pub struct Pose {
    /// Unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Along x, y, z.
    pub translation: [f64; 3],
}
