//! `proact emg test`: can this person use this model?

mod virtual_limb;

use super::{
    FaultArgs, calibration_page::CalibrationPage, source_args::SourceArgs, train::CalibrationPageArgs,
};
use crate::{interrupt::interrupt_flag, progress::progress_bar};
use clap::{Args, ValueEnum};
use indicatif::ProgressBar;
use proact_app::{
    OffsetCorrectedStream,
    emg_model_file::{model_uses_imu, read_model},
    print_result, print_result_json,
};
use proact_bridge::{CalibrationView, GestureTest, TestKind};
use proact_devices::{SourceEvent, SourceRegistry, findings_json, open_pipeline, random_stream};
use proact_emg::{
    Adaptation, AdaptationConfig, CursorConfig, CursorEvent, CursorTest, EmgOutput, EmgPipeline, HoldConfig,
    HoldTest, SequenceConfig, SequenceTest,
};
use proact_files::{check_output, is_regular_or_missing, write_atomically};
use proact_types::{Gesture, SimTime};
use rand::seq::SliceRandom;
use serde_json::{Value, json};
use std::{
    error::Error,
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

/// Options of `proact emg test`.
#[derive(Debug, Args)]
pub struct EmgTestArgs {
    #[command(flatten)]
    source: SourceArgs,
    /// Model file, as training writes it.
    #[arg(long)]
    model: PathBuf,
    /// Samples per second of the source, if it does not say.
    #[arg(long = "emg-rate")]
    rate_hz: Option<f64>,
    /// Which tests, in this order, with commas between.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "TEST,..", default_value = "sequence,trial")]
    tests: Vec<TestName>,
    /// Prompts of the longer trial, each of 3 s.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=1000))]
    prompts: u16,
    /// Share of the longer trial that passes.
    #[arg(long, value_name = "P", default_value_t = 0.75)]
    target_accuracy: f64,
    /// Sequences in a row that pass.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=100))]
    consecutive_sequences: u8,
    /// Sequences after which the sequence test is failed.
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u8).range(1..=100))]
    max_sequences: u8,
    /// How often the motion test asks for each gesture.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=100))]
    motion_repetitions: u8,
    /// Targets of each axis of tac1, and of all axes of tac3.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=100))]
    tac_repetitions: u8,
    /// Targets on each of the three rings of the cursor test, an odd number.
    #[arg(long, value_name = "N", default_value_t = 9)]
    cursor_targets: u8,
    /// Seconds in a target that complete a movement of the cursor test; they are not counted into its time.
    #[arg(long, default_value_t = 1.0)]
    dwell: f64,
    /// Gestures that move the cursor right, left, up and down, with commas between.
    #[arg(
        long,
        value_delimiter = ',',
        num_args = 1..=4,
        value_name = "NAMES",
        default_value = "wrist_extension,wrist_flexion,hand_open,hand_close"
    )]
    steering: Vec<Gesture>,
    /// The cursor always moves at full speed, whatever the effort.
    #[arg(long)]
    constant_speed: bool,
    /// Learn from the longer trial: a window that was recognised as prompted is confirmed, and moves the class means and
    /// covariance a little. The adapted model goes to this new file if the tests are passed; the old one stays.
    #[arg(long, value_name = "MODEL")]
    adapt: Option<PathBuf>,
    #[command(flatten)]
    faults: FaultArgs,
    #[command(flatten)]
    page: CalibrationPageArgs,
}

/// The tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TestName {
    /// All gestures in a prescribed order, three times in a row without a mistake.
    Sequence,
    /// A longer trial: at least 75 % of decisions right.
    Trial,
    /// The motion test of Kuiken et al. 2009: how fast and how surely each gesture is selected and kept. Nothing to pass.
    Motion,
    /// Target achievement control of one joint after the other: a virtual wrist and a grasp, with miniVIE's numbers. Nothing to pass.
    Tac1,
    /// The same of up to three joints together.
    Tac3,
    /// Pointing with a cursor, as in ISO 9241-411. Nothing to pass.
    Cursor,
}

impl TestName {
    /// How the page calls it.
    fn kind(self) -> TestKind {
        match self {
            TestName::Sequence => TestKind::Sequence,
            TestName::Trial => TestKind::Trial,
            TestName::Motion => TestKind::Motion,
            TestName::Tac1 => TestKind::Tac1,
            TestName::Tac3 => TestKind::Tac3,
            TestName::Cursor => TestKind::Cursor,
        }
    }
}

/// Runs the tests; success only if those that can be passed are passed.
///
/// # Errors
/// A source or model that cannot be used, or a test that is failed.
pub(super) fn run(sources: &SourceRegistry, args: &EmgTestArgs, json: bool) -> Result<(), Box<dyn Error>> {
    if let Some(path) = args.source.source.file() {
        return Err(format!("file:{} makes no gestures that are asked for; a recording can act as a person with person:FOLDER", path.display()).into());
    }
    if let Some(out) = &args.adapt {
        if !args.tests.contains(&TestName::Trial) {
            return Err("--adapt learns from the longer trial; name it with --tests".into());
        }
        if out.exists() && is_regular_or_missing(out) {
            return Err(format!("{} is there already; name another file with --adapt", out.display()).into());
        }
        check_output(out)?;
    }
    let stop = interrupt_flag()?;
    let source =
        args.source.open(sources, args.rate_hz, model_uses_imu(&args.model)?, args.faults.policy())?;
    let info = source.info().clone();
    let findings = findings_json(source.findings());
    let model = read_model(&args.model, &info)?;
    let pipeline = open_pipeline(&model, args.source.no_realtime)?;
    let stream = OffsetCorrectedStream::new(source, args.source.adc_zero, &model);
    let adaptation =
        args.adapt.as_ref().map(|_| Adaptation::new(AdaptationConfig::default(), &model)).transpose()?;
    let (gestures, rest) = (model.classifier.gestures().to_vec(), model.config.rest);
    if args.tests.contains(&TestName::Cursor)
        && let Some(unknown) = args.steering.iter().find(|gesture| !gestures.contains(gesture))
    {
        let known: Vec<&str> = gestures.iter().map(Gesture::as_str).collect();
        return Err(format!(
            "the model has no {unknown} to move the cursor with; name four of its gestures with --steering: {}",
            known.join(", ")
        )
        .into());
    }
    let mut live =
        LiveRecognition { stream, pipeline, adaptation, gestures, rest, in_force: rest, effort: 0.0, stop };
    let mut show = TestDisplay {
        page: None,
        bar: progress_bar(!json && !args.page.page, 1, "{prefix:10} {bar:30} {pos} of {len}  {msg}"),
        last_prompt: None,
    };
    if args.page.page {
        show.page = Some(CalibrationPage::open(&args.page, &info.name)?);
    }
    let mut result = json!({ "model": args.model.display().to_string(), "source": info.name,
        "findings": findings, "accepted_faults": model.accepted_faults });
    let mut failed = Vec::new();
    for test in &args.tests {
        show.wait_for_start(&mut live, test.kind())?;
        let (name, report, passed) = match test {
            TestName::Sequence => sequence(args, &mut live, &mut show)?,
            TestName::Trial => trial(args, &mut live, &mut show)?,
            TestName::Motion => virtual_limb::motion(args, &mut live, &mut show)?,
            TestName::Tac1 => virtual_limb::tac(args, &mut live, &mut show, false)?,
            TestName::Tac3 => virtual_limb::tac(args, &mut live, &mut show, true)?,
            TestName::Cursor => cursor(args, &mut live, &mut show)?,
        };
        result[name] = report;
        if !passed {
            failed.push(name);
        }
    }
    result["passed"] = json!(failed.is_empty());
    if let (Some(adaptation), Some(out)) = (&live.adaptation, &args.adapt) {
        if failed.is_empty() {
            write_atomically(out, &adaptation.model().to_json()?)?;
        }
        result["adaptation"] = json!({ "windows": adaptation.used(), "drift": adaptation.drift(),
            "model": failed.is_empty().then(|| out.display().to_string()) });
    }
    show.bar.finish_and_clear();
    if let Some(page) = &mut show.page {
        page.end(&result);
    }
    if json {
        print_result_json(&result)?;
    } else {
        print_result(report_text(&result).trim_end())?;
    }
    if failed.is_empty() {
        return Ok(());
    }
    Err(format!(
        "not passed: {}; record more repetitions with proact emg train, or practise",
        failed.join(", ")
    )
    .into())
}

fn sequence(
    args: &EmgTestArgs,
    live: &mut LiveRecognition,
    show: &mut TestDisplay,
) -> Result<(&'static str, Value, bool), Box<dyn Error>> {
    let mut test = SequenceTest::new(SequenceConfig {
        required_consecutive: args.consecutive_sequences.into(),
        attempts: args.max_sequences.into(),
        ..SequenceConfig::for_gestures(&live.gestures, live.rest)
    })?;
    while !test.is_finished() {
        live.advance()?;
        if test.step(live.now(), live.in_force) {
            live.prompt(test.prompt());
        }
        show.show_test(GestureTest::Sequence(test.report()), test.prompt(), live.in_force);
    }
    Ok(("sequence", json!(test.report()), test.report().passed))
}

fn trial(
    args: &EmgTestArgs,
    live: &mut LiveRecognition,
    show: &mut TestDisplay,
) -> Result<(&'static str, Value, bool), Box<dyn Error>> {
    let mut rng = random_stream(args.source.seed, "emg/test/prompts");
    let mut prompts = Vec::new();
    while prompts.len() < usize::from(args.prompts) {
        // Each gesture once in a round of prompts, in an order that nobody can learn.
        let mut round = live.gestures.clone();
        round.shuffle(&mut rng);
        prompts.extend(round);
    }
    prompts.truncate(args.prompts.into());
    let mut test = HoldTest::new(HoldConfig {
        gestures: live.gestures.clone(),
        prompts,
        target_accuracy: args.target_accuracy,
        ..HoldConfig::default()
    })?;
    while !test.is_finished() {
        let decided = live.advance()?.map(|output| output.gesture);
        let counted = test.report().decisions;
        if test.step(live.now(), decided) {
            live.prompt(test.prompt());
        }
        if test.report().decisions > counted {
            live.confirm(test.prompt())?;
        }
        show.show_test(GestureTest::Trial(test.report()), test.prompt(), live.in_force);
    }
    Ok(("trial", json!(test.report()), test.report().passed))
}

fn cursor(
    args: &EmgTestArgs,
    live: &mut LiveRecognition,
    show: &mut TestDisplay,
) -> Result<(&'static str, Value, bool), Box<dyn Error>> {
    let steering = args.steering.as_slice().try_into().map_err(|_| "--steering expects four gestures")?;
    let mut test = CursorTest::new(CursorConfig {
        steering,
        targets: args.cursor_targets.into(),
        dwell_secs: args.dwell,
        proportional: !args.constant_speed,
        ..CursorConfig::default()
    })?;
    let mut person = SimulatedCursorUser::default();
    while !test.is_finished() {
        let decided = live.advance()?;
        let event = test.step(live.now(), live.in_force, live.effort);
        if decided.is_some()
            && let Some(wanted) = person.next_gesture(&test, live.now(), live.rest)
        {
            live.prompt(Some(wanted));
        }
        if let Some(page) = &mut show.page {
            page.show_cursor(
                &test,
                live.in_force,
                live.effort,
                matches!(event, Some(CursorEvent::MovementEnded(_))),
            );
        }
        show.show_progress("cursor", test.report().movements.len() as u64, test.report().target_count as u64);
    }
    live.prompt(None);
    Ok(("cursor", json!(test.report()), true))
}

/// What a simulated person does at the cursor test: one axis after the other, letting go early by the time that the
/// way from intention to cursor takes. People see the cursor instead.
#[derive(Default)]
struct SimulatedCursorUser {
    current_gesture: Option<Gesture>,
    last_cursor: Option<(SimTime, [f64; 2])>,
}

/// From intention to cursor: reaction, onset, a window and three decisions.
const CONTROL_LAG_SECS: f64 = 0.5;

impl SimulatedCursorUser {
    /// The gesture to make from now on, if it is another one.
    fn next_gesture(&mut self, test: &CursorTest, now: SimTime, rest: Gesture) -> Option<Gesture> {
        let [right, left, up, down] = test.config().steering;
        let ([x, y], (target, width)) = (test.cursor(), test.target());
        let speed = self.last_cursor.map_or([0.0; 2], |(then, [bx, by])| {
            let secs = (now.millis_since(then) as f64 / 1000.0).max(1e-3);
            [(x - bx) / secs, (y - by) / secs]
        });
        self.last_cursor = Some((now, [x, y]));
        let off = [target[0] - x - CONTROL_LAG_SECS * speed[0], target[1] - y - CONTROL_LAG_SECS * speed[1]];
        let reach = 0.3 * width;
        let wanted = match off {
            [dx, _] if dx > reach => right,
            [dx, _] if dx < -reach => left,
            [_, dy] if dy > reach => up,
            [_, dy] if dy < -reach => down,
            _ => rest,
        };
        (self.current_gesture.replace(wanted) != Some(wanted)).then_some(wanted)
    }
}

/// The stream and what is recognised in it.
struct LiveRecognition {
    stream: OffsetCorrectedStream,
    pipeline: EmgPipeline,
    adaptation: Option<Adaptation>,
    /// Those of the model, and which of them is the relaxed hand.
    gestures: Vec<Gesture>,
    rest: Gesture,
    in_force: Gesture,
    effort: f64,
    stop: Arc<AtomicBool>,
}

impl LiveRecognition {
    /// Takes what the source brings next; the newest decision in it.
    fn advance(&mut self) -> Result<Option<EmgOutput>, Box<dyn Error>> {
        if self.stop.load(Ordering::Relaxed) {
            return Err("stopped before the end of the test".into());
        }
        if self.stream.next(|_| Ok(()))? == SourceEvent::Ended {
            return Err("the source ended before the test did".into());
        }
        let output = self.pipeline.step(self.stream.now, &self.stream.packet.samples);
        if let Some(output) = &output {
            self.in_force = output.gesture;
            // The effort of the class that the rule has not taken over yet is not that of the gesture in force.
            self.effort = if output.class == Some(output.gesture) { output.effort } else { 0.0 };
        }
        Ok(output)
    }

    /// The newest window is one of `gesture`, which was asked for long enough ago.
    fn confirm(&mut self, gesture: Option<Gesture>) -> Result<(), Box<dyn Error>> {
        if let (Some(adaptation), Some(gesture)) = (&mut self.adaptation, gesture)
            && !self.pipeline.features().is_empty()
            && adaptation.confirm(gesture, self.pipeline.features())?
        {
            self.pipeline.set_classifier(adaptation.classifier().clone())?;
        }
        Ok(())
    }

    fn now(&self) -> SimTime {
        self.stream.now
    }

    fn prompt(&mut self, gesture: Option<Gesture>) {
        self.stream.source.prompt(gesture.unwrap_or(self.rest));
    }
}

/// Where a test is shown.
struct TestDisplay {
    page: Option<CalibrationPage>,
    bar: ProgressBar,
    last_prompt: Option<Gesture>,
}

impl TestDisplay {
    /// Waits for the button on the page, which says what comes `next`.
    fn wait_for_start(&mut self, live: &mut LiveRecognition, next: TestKind) -> Result<(), Box<dyn Error>> {
        let Some(page) = &mut self.page else { return Ok(()) };
        page.await_begin();
        while !page.has_begun() {
            live.advance()?;
            page.publish(false, || CalibrationView::Ready { next });
        }
        Ok(())
    }

    fn show_test(&mut self, test: GestureTest, prompt: Option<Gesture>, in_force: Gesture) {
        if let Some(page) = &mut self.page {
            page.show_test(test, prompt, in_force);
        }
        self.show_prompt(prompt);
        match test {
            GestureTest::Sequence(report) => {
                self.show_progress("sequence", report.consecutive_correct as u64, 3)
            }
            GestureTest::Trial(report) => self.show_progress("trial", report.prompts as u64, 20),
        }
    }

    fn show_prompt(&mut self, prompt: Option<Gesture>) {
        if prompt != self.last_prompt {
            self.last_prompt = prompt;
            self.bar.set_message(prompt.map_or(String::new(), String::from));
        }
    }

    fn show_progress(&mut self, name: &'static str, done: u64, all: u64) {
        self.bar.set_prefix(name);
        self.bar.set_length(all.max(done));
        self.bar.set_position(done);
    }
}

/// The result for reading.
fn report_text(result: &Value) -> String {
    let mut out = String::new();
    let passed = |report: &Value| if report["passed"] == true { "passed" } else { "NOT PASSED" };
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    if let Some(report) = result.get("sequence") {
        let mistakes = report["mistakes"].as_array().map_or(0, Vec::len);
        out += &format!(
            "sequence: {}, {} in a row after {} sequences, {mistakes} mistakes, {:.2} s from prompt to gesture\n",
            passed(report),
            report["in_a_row"],
            report["attempts"],
            number(&report["mean_delay_secs"])
        );
    }
    if let Some(report) = result.get("trial") {
        out += &format!(
            "longer trial: {}, {:.1} % of {} decisions right\n",
            passed(report),
            100.0 * number(&report["accuracy"]),
            report["decisions"]
        );
    }
    if let Some(report) = result.get("adaptation") {
        out += &format!(
            "adaptation: {} windows used, class means moved by {:.2} standard deviations; {}\n",
            report["windows"],
            number(&report["drift"]),
            report["model"].as_str().map_or("not kept".to_owned(), |file| format!("the model is in {file}"))
        );
    }
    out += &virtual_limb::report_text(result);
    if let Some(report) = result.get("cursor") {
        out += &format!(
            "cursor: throughput {:.2} bit/s (dwell not counted; {:.2} with it), path efficiency {:.0} %, \
             {:.2} overshoots a target, {:.0} % completed\n",
            number(&report["throughput_bits_per_s"]),
            number(&report["throughput_with_dwell_bits_per_s"]),
            100.0 * number(&report["path_efficiency"]),
            number(&report["overshoots"]),
            100.0 * number(&report["completion_rate"])
        );
    }
    out
}
