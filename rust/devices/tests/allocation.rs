//! The live path from the armband's bytes to the gesture does not allocate once it runs.
#![allow(clippy::unwrap_used)]

use proact_devices::{
    EmgOrigin, EmgPacket,
    gforce::{GForceParser, protocol::EmgSetting, split_into_fragments},
    prepare_emg,
};
use proact_emg::EmgPipeline;
use proact_types::SimTime;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::{alloc::System, time::Duration};

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn bytes_become_gestures_without_allocation_whole_and_in_fragments() {
    let setup = prepare_emg(&EmgOrigin::Synthetic, 1).unwrap();
    for notification_bytes in [244, 20] {
        let notifications: Vec<(u64, Vec<u8>)> = (0..400_u64)
            .flat_map(|number| {
                // The middle bits, which do not come again soon: what repeats itself is no arm.
                let codes = (0..128).map(|k| ((number * 128 + k).wrapping_mul(2_654_435_761) >> 16) as u8);
                let message: Vec<u8> = [0x08, number as u8].into_iter().chain(codes).collect();
                split_into_fragments(&message, notification_bytes)
                    .into_iter()
                    .map(move |piece| (16 * number, piece))
            })
            .collect();
        let mut parser = GForceParser::new(EmgSetting::PROACT_DEFAULT, true).unwrap();
        let mut pipeline = EmgPipeline::new(&setup.config, setup.classifier.clone()).unwrap();
        let mut packet = EmgPacket::default();
        let mut decisions = 0;
        let mut run = |range: std::ops::Range<usize>| {
            for (millis, bytes) in &notifications[range] {
                if parser.push(bytes, Duration::from_millis(*millis), &mut packet) {
                    for sample in &packet.samples {
                        let output = pipeline.step(SimTime(*millis), std::slice::from_ref(sample));
                        decisions += u32::from(output.is_some());
                    }
                }
            }
        };
        // The first packets make the room that all others use.
        let start = notifications.len() / 10;
        run(0..start);
        let region = Region::new(COUNTED);
        run(start..notifications.len());
        let used = region.change();
        assert_eq!(
            (used.allocations, used.reallocations),
            (0, 0),
            "{notification_bytes} bytes a notification"
        );
        assert!(decisions > 100);
    }
}
