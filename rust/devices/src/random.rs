use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The random stream called `name` of the trial or study seeded with `seed`.
///
/// Its key is the BLAKE3 hash of the context `proact random stream`, a zero byte, the seed as 8 little-endian
/// bytes, and the name. Streams of different names or seeds are independent; drawing more from one never changes
/// another.
pub fn random_stream(seed: u64, name: &str) -> ChaCha8Rng {
    let mut hasher = blake3::Hasher::new();
    hasher.update(b"proact random stream\0");
    hasher.update(&seed.to_le_bytes());
    hasher.update(name.as_bytes());
    ChaCha8Rng::from_seed(*hasher.finalize().as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn a_stream_depends_on_seed_and_name_and_on_nothing_else() {
        let draw = |seed, name| random_stream(seed, name).next_u64();
        assert_eq!(draw(1, "gaze"), draw(1, "gaze"));
        assert_ne!(draw(1, "gaze"), draw(2, "gaze"));
        assert_ne!(draw(1, "gaze"), draw(1, "emg"));
    }
}
