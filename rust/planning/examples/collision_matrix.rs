//! Which pairs of links never or always touch, over random arm and hand postures: material for the list of
//! allowed collisions in the SRDF.
//!
//!     cargo run --release -p proact-planning --example collision_matrix -- [postures]

use proact_planning::CollisionScene;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;

/// Half the postures bend each joint to one of its limits, where contacts are most likely.
fn posture(random: &mut ChaCha8Rng, limits: &[(f64, f64)]) -> Vec<f64> {
    let extreme = random.next_u64() & 1 == 1;
    let angle = |(low, high): &(f64, f64)| {
        let unit = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let unit = if extreme { unit.round() } else { unit };
        low + (high - low) * unit
    };
    limits.iter().map(angle).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let postures: u32 = std::env::args().nth(1).map_or(Ok(50_000), |text| text.parse())?;
    let model = proact_description::mpl_right_arm();
    let mut bare = model.clone();
    bare.allowed_collisions.clear();
    let mut scene = CollisionScene::new(&bare)?;
    let limits = |group: &[usize]| -> Vec<(f64, f64)> {
        group.iter().map(|&j| (model.joints[j].limits.lower, model.joints[j].limits.upper)).collect()
    };
    let (arm, hand) = (limits(&model.arm), limits(&model.hand));
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut counts: BTreeMap<(usize, usize), u32> = BTreeMap::new();
    for _ in 0..postures {
        scene.set_hand(&posture(&mut random, &hand))?;
        for (a, b) in scene.collisions_of_all_links(&posture(&mut random, &arm))? {
            let (a, b) = (model.link(&a)?, model.link(&b)?);
            *counts.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    let adjacent = |a: usize, b: usize| model.joints.iter().any(|j| (j.parent, j.child) == (a, b));
    let allowed = |a: usize, b: usize| {
        model.allowed_collisions.contains(&(a, b)) || model.allowed_collisions.contains(&(b, a))
    };
    println!("{postures} postures, seed 1; columns: verdict, share touching, now allowed, links");
    let solid: Vec<usize> =
        (0..model.links.len()).filter(|&k| !model.links[k].collisions.is_empty()).collect();
    for (i, &a) in solid.iter().enumerate() {
        for &b in &solid[i + 1..] {
            let count = counts.get(&(a, b)).copied().unwrap_or(0);
            let verdict = match count {
                _ if adjacent(a, b) => "adjacent",
                0 => "never",
                n if n == postures => "always",
                _ => "sometimes",
            };
            let share = f64::from(count) / f64::from(postures);
            println!(
                "{verdict} {share:.4} {} {} {}",
                allowed(a, b),
                model.links[a].name,
                model.links[b].name
            );
        }
    }
    Ok(())
}
