use super::*;
use proact_types::Gesture;

const CHANNELS: usize = 4;
const RATE_HZ: f64 = 200.0;

/// Noise of standard deviation one, nearly Gaussian, from a counter.
fn noise(seed: u64, k: u64) -> f64 {
    (0..4).map(|part| uniform(seed.wrapping_add(1000 * part), k)).sum::<f64>() / 2.0
}

fn uniform(seed: u64, k: u64) -> f64 {
    let mut z =
        seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(k.wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5) * 12_f64.sqrt()
}

type Session = Vec<(GestureName, u32, Vec<EmgSample>)>;

/// Three repetitions of rest and of a fist of 3 s, channel 1 changed by `change(seconds, value)`.
fn session(change: impl Fn(f64, f64) -> f64) -> Session {
    let mut session = Vec::new();
    for repetition in 0..3 {
        for (gesture, strength) in [(Gesture::NoMotion, 3.0), (Gesture::HandClose, 20.0)] {
            let seed = u64::from(repetition) * 16 + strength as u64 * 100;
            let sample = |k: u64| {
                let value = |c: u64| (strength * noise(seed + c, k)).round().clamp(-128.0, 127.0);
                let mut channels: Vec<f64> = (0..CHANNELS as u64).map(value).collect();
                channels[1] = change(k as f64 / RATE_HZ, channels[1]);
                EmgSample { counter: k, channels: channels.into_iter().collect() }
            };
            session.push((gesture.into(), repetition, (0..600).map(sample).collect()));
        }
    }
    session
}

fn check(session: &Session) -> Vec<RecordedFault> {
    let recordings: Vec<RecordedRepetition<'_>> = session
        .iter()
        .map(|(gesture, repetition, samples)| RecordedRepetition {
            gesture: *gesture,
            repetition: *repetition,
            samples,
        })
        .collect();
    check_recordings(&QualityConfig::default(), RATE_HZ, CHANNELS, Gesture::NoMotion.into(), &recordings)
}

fn on_channel_1(finding: ChannelFault) -> impl Fn(&RecordedFault) -> bool {
    move |fault| matches!(fault, RecordedFault::Channel { channel: 1, light: Light::Red, finding: f, .. } if *f == finding)
}

#[test]
fn good_recordings_have_no_fault() {
    assert_eq!(check(&session(|_, v| v)), []);
}

#[test]
fn each_planted_fault_is_the_only_one_found() {
    let only = |change: &dyn Fn(f64, f64) -> f64| {
        let mut faults = check(&session(change));
        assert_eq!(faults.len(), 1, "{faults:?}");
        faults.remove(0)
    };
    assert!(on_channel_1(ChannelFault::Flat)(&only(&|_, _| 3.0)));
    let hum = |t: f64, v: f64| v + 40.0 * (std::f64::consts::TAU * 50.0 * t).sin();
    assert!(on_channel_1(ChannelFault::Mains)(&only(&hum)));
    assert!(on_channel_1(ChannelFault::Railed)(&only(&|_, v| (1.5 * v).clamp(-20.0, 20.0))));
    assert_eq!(only(&|t, _| 1000.0 + t), RecordedFault::TimeStamps { channel: 1 });
    let loud = |t: f64, _: f64| (40.0 * noise(7, (t * 200.0).round() as u64)).round();
    assert!(matches!(only(&loud), RecordedFault::Noisy { channel: 1, times } if times > 5.0));
}

#[test]
fn a_channel_that_is_red_in_few_recordings_is_told_with_their_names_and_refused_in_most() {
    let dead_in = |count: usize| {
        let mut session = session(|_, v| v);
        for (.., samples) in session.iter_mut().take(count) {
            samples.iter_mut().for_each(|sample| sample.channels[1] = 3.0);
        }
        let mut faults = check(&session);
        assert_eq!(faults.len(), 1, "{faults:?}");
        faults.remove(0)
    };
    let (one, most) = (dead_in(1), dead_in(4));
    assert_eq!((one.light(), most.light()), (Light::Amber, Light::Red));
    let rest = GestureName::from(Gesture::NoMotion);
    assert!(
        matches!(&one, RecordedFault::Channel { recordings, of: 6, .. } if *recordings == [(rest, 0)]),
        "{one:?}"
    );
}

#[test]
fn repetitions_that_share_samples_are_named_whole_or_in_part() {
    let mut copied = session(|_, v| v);
    copied[5].2 = copied[1].2.clone();
    let close = GestureName::from(Gesture::HandClose);
    let expected = RecordedFault::Shared { first: (close, 0), second: (close, 2), samples: 600, of: 600 };
    assert_eq!(check(&copied), [expected]);
    // The second half of one recording is the beginning of the next.
    let mut cut = session(|_, v| v);
    let half = cut[1].2[290..].to_vec();
    cut[3].2.splice(..half.len(), half);
    match check(&cut).as_slice() {
        [RecordedFault::Shared { first, second, samples, of: 600 }] => {
            assert_eq!((*first, *second), ((close, 0), (close, 1)));
            assert!((280..=310).contains(samples), "{samples}");
        }
        other => panic!("{other:?}"),
    }
}
