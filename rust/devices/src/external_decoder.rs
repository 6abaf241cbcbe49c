//! A classifier or regressor in another process: started here, trained and asked line by line.

use crate::{DeviceError, LineProcess, LineProcessError, random_stream};
use proact_emg::{
    Classifier, DecodeRequest, DecoderInput, DecoderProcess, DecoderProcessConfig, EmgConfig, EmgModel,
    EmgPipeline, Prediction, extract_decoder_inputs, start_request,
};
use proact_types::{DegreeOfFreedom, EmgSample, Gesture, WindowAnswer};
use rand_distr::{Distribution, StandardNormal};
use serde::Deserialize;
use serde_json::{Value, json};
use std::{
    fs::File,
    path::{Path, PathBuf},
    time::Duration,
};

/// A line longer than this is no answer, bytes. What a training gives is an answer too.
const MAX_LINE_BYTES: u64 = 16 << 20;
/// A program has to read its libraries before it answers first.
const START_TIMEOUT: Duration = Duration::from_secs(60);
/// Training may take long, but not for ever.
const TRAIN_TIMEOUT: Duration = Duration::from_secs(3600);
/// In a batch, and of recordings, each answer is waited for, but not for ever.
const BATCH_TIMEOUT: Duration = Duration::from_secs(10);

/// A running program that decodes windows.
#[derive(Debug)]
pub struct ExternalDecoderProcess {
    process: LineProcess,
    timeout: Duration,
}

/// What a program answers to its first line, and to its training.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReadyResponse {
    #[serde(rename = "window")]
    _window: u64,
    #[serde(default)]
    state: Value,
    #[serde(default)]
    error: Option<String>,
}

impl ExternalDecoderProcess {
    /// Starts the program of `classifier`, if it is one. A live trial does not wait `for_each_answer`.
    ///
    /// # Errors
    /// A program that does not start, or does not say that it is ready.
    pub fn start(
        config: &EmgConfig,
        classifier: &Classifier,
        for_each_answer: bool,
    ) -> Result<Option<ExternalDecoderProcess>, DeviceError> {
        let (Some(begin), Some(process)) = (classifier.start_request(config), &config.process) else {
            return Ok(None);
        };
        let timeout =
            if for_each_answer { BATCH_TIMEOUT } else { Duration::from_millis(process.deadline_ms) };
        Self::start_with(process, begin?, timeout).map(Some)
    }

    fn start_with(
        config: &DecoderProcessConfig,
        begin: String,
        timeout: Duration,
    ) -> Result<Self, DeviceError> {
        let command = || config.command.join(" ");
        let process = LineProcess::start(&config.command, MAX_LINE_BYTES)
            .map_err(|source| DeviceError::DecoderStart { command: command(), reason: source.to_string() })?;
        let mut decoder = ExternalDecoderProcess { process, timeout };
        let ready = decoder.request(begin, START_TIMEOUT);
        ready.map_err(|reason| DeviceError::DecoderStart { command: command(), reason })?;
        Ok(decoder)
    }

    /// The answer to a line that is no window's.
    fn request(&mut self, line: String, timeout: Duration) -> Result<Value, String> {
        let text = self.process.ask(0, line, timeout).map_err(|fault| fault.to_string())?;
        let excerpt: String = text.chars().take(120).collect();
        let ready: ReadyResponse = serde_json::from_str(&text)
            .map_err(|error| format!("it answered {excerpt:?}: {error}, expected {{\"window\": 0}}"))?;
        ready.error.map_or(Ok(ready.state), |error| Err(format!("it says {error:?}")))
    }

    /// What the program says of a window of a recording, number `window`.
    ///
    /// # Errors
    /// [`DeviceError::Decoder`].
    pub fn predict(
        &mut self,
        classifier: &Classifier,
        window: u64,
        input: &DecoderInput,
    ) -> Result<Prediction, DeviceError> {
        let failed = |reason| DeviceError::Decoder { reason };
        let mut line = input.request.clone().ok_or_else(|| failed("no window was kept for it".to_owned()))?;
        line.window = window;
        let answer = match self.decode(window, &line.text()) {
            WindowAnswer::Line(answer) => answer,
            WindowAnswer::TimedOut { deadline_ms } => {
                return Err(failed(format!("it has not answered within {deadline_ms} ms")));
            }
            WindowAnswer::Failed(reason) => return Err(failed(reason)),
        };
        classifier.parse_response(window, &answer).map_err(failed)
    }
}

impl DecoderProcess for ExternalDecoderProcess {
    fn decode(&mut self, window: u64, line: &str) -> WindowAnswer {
        match self.process.ask(window, line.to_owned(), self.timeout) {
            Ok(answer) => WindowAnswer::Line(answer),
            // A window that waits to be read has no answer in time either.
            Err(LineProcessError::Timeout { .. } | LineProcessError::InputNotRead) => {
                WindowAnswer::TimedOut { deadline_ms: self.timeout.as_millis() as u64 }
            }
            Err(fault) => WindowAnswer::Failed(fault.to_string()),
        }
    }
}

/// The pipeline of `model`, with its process started if it is decoded by one.
///
/// # Errors
/// A model that cannot be used, a program that does not start.
pub fn open_pipeline(model: &EmgModel, for_each_answer: bool) -> Result<EmgPipeline, DeviceError> {
    let process = ExternalDecoderProcess::start(&model.config, &model.classifier, for_each_answer)?;
    let pipeline = EmgPipeline::new(&model.config, model.classifier.clone())?;
    Ok(pipeline.with_decoder(process.map(|process| -> Box<dyn DecoderProcess> { Box::new(process) })))
}

/// Windows of a recording of one gesture.
pub(crate) type LabelledWindows = (Gesture, Vec<DecoderInput>);

/// Has the program of `config` learn from `windows`; what it learnt, as JSON text.
///
/// # Errors
/// A program that does not start, or refuses.
pub(crate) fn fit(
    config: &EmgConfig,
    gestures: &[Gesture],
    windows: &[LabelledWindows],
) -> Result<String, DeviceError> {
    let Some(process) = &config.process else { return Err(config_error(config)) };
    let driven: &[DegreeOfFreedom] =
        if config.classifier.is_regression() { &config.regression.drives } else { &[] };
    let mut decoder = ExternalDecoderProcess::start_with(
        process,
        start_request(config, gestures, driven, "")?,
        BATCH_TIMEOUT,
    )?;
    let each = || windows.iter().flat_map(|(gesture, windows)| windows.iter().map(move |w| (gesture, w)));
    let labels: Vec<&Gesture> = each().map(|(gesture, _)| gesture).collect();
    let targets: Vec<Vec<f64>> =
        labels.iter().map(|gesture| driven.iter().map(|drive| drive.target(**gesture)).collect()).collect();
    let features_json = |window: &DecoderInput| match window.request.as_ref() {
        Some(DecodeRequest { features: Some(features), .. }) => json!(features),
        Some(DecodeRequest { samples: Some(samples), .. }) => json!(samples),
        _ => Value::Null,
    };
    let lines: Vec<Value> = each().map(|(_, window)| features_json(window)).collect();
    let fit = json!({ "window": 0, "fit": { "windows": lines, "labels": labels, "targets": targets } });
    let state = decoder
        .request(fit.to_string(), TRAIN_TIMEOUT)
        .map_err(|reason| DeviceError::Decoder { reason: format!("training: {reason}") })?;
    Ok(state.to_string())
}

fn config_error(config: &EmgConfig) -> DeviceError {
    let reason = format!("emg.classifier is {}, expected process or process_regressor", config.classifier);
    DeviceError::Decoder { reason }
}

/// The model of `stand_in`, which was trained on `recordings` with [`EmgConfig::stand_in`], decoded by the process of
/// `config` after it has learnt from the same recordings. These are as the stream gives them, before centring.
///
/// # Errors
/// A program that does not start or refuses; gestures that are not those that it knows.
pub fn train_process(
    config: &EmgConfig,
    stand_in: EmgModel,
    recordings: &[(Gesture, &[EmgSample])],
) -> Result<EmgModel, DeviceError> {
    let mut windows = Vec::with_capacity(recordings.len());
    for (gesture, samples) in recordings {
        let centered: Vec<EmgSample> =
            samples.iter().map(|sample| stand_in.subtract_dc_offset(sample)).collect();
        windows.push((*gesture, extract_decoder_inputs(config, &centered)?));
    }
    let state = fit(config, stand_in.classifier.gestures(), &windows)?;
    Ok(stand_in.decoded_by_process(config, &state)?)
}

/// Windows of each gesture that a program is tried with.
const PROBE_WINDOWS: usize = 8;
/// Standard deviation of the samples that a program is tried with, of the weakest electrode: codes of an armband.
const PROBE_AMPLITUDE: f64 = 4.0;

/// Tries the program of `config` before anybody holds a gesture: it is started, learns from a few made-up windows of each gesture,
/// is started anew with what it learnt, and recognises one. Nothing is kept of it.
///
/// The windows are Gaussian noise, each gesture strongest on electrodes of its own; they say nothing of how well it will do. The
/// same settings give the same windows.
///
/// # Errors
/// What the program gets wrong; settings that cannot work.
pub fn try_process(config: &EmgConfig, gestures: &[Gesture]) -> Result<(), DeviceError> {
    let mut rng = random_stream(0, "emg/process/tried");
    let samples = config.window_samples()? + (PROBE_WINDOWS - 1) * config.increment_samples()?;
    let mut windows = Vec::with_capacity(gestures.len());
    for (number, gesture) in gestures.iter().enumerate() {
        let mut sample = |counter: usize| {
            let mut value = |channel: usize| {
                let own = if channel % gestures.len() == number { 8.0 } else { 1.0 };
                let noise: f64 = StandardNormal.sample(&mut rng);
                PROBE_AMPLITUDE * own * noise
            };
            let channels = (0..config.sample_channels()).map(&mut value).collect();
            EmgSample { counter: counter as u64, channels }
        };
        let made_up: Vec<EmgSample> = (0..samples).map(&mut sample).collect();
        windows.push((*gesture, extract_decoder_inputs(config, &made_up)?));
    }
    let each = || windows.iter().flat_map(|(gesture, windows)| windows.iter().map(move |w| (gesture, w)));
    let (labels, features): (Vec<Gesture>, Vec<&[f64]>) =
        each().map(|(gesture, window)| (*gesture, window.features.as_slice())).unzip();
    let stand_in = Classifier::train(&config.without_process(), &features, &labels)?;
    let state = fit(config, stand_in.gestures(), &windows)?;
    let classifier = stand_in.decoded_by_process(config, &state)?;
    if let (Some(mut process), Some((_, window))) =
        (ExternalDecoderProcess::start(config, &classifier, true)?, each().next())
    {
        process.predict(&classifier, 1, window)?;
    }
    Ok(())
}

/// Reads the file (TOML) of a program that decodes. Words of its command that begin with `./` are files beside it.
///
/// # Errors
/// A file that cannot be read, or is none of a program.
pub fn read_process_file(path: &Path) -> Result<DecoderProcessConfig, DeviceError> {
    let unreadable = |source| DeviceError::Read { path: path.to_owned(), source };
    let text = File::open(path)
        .and_then(|file| proact_types::read_text(file, proact_types::MAX_TEXT_BYTES))
        .map_err(unreadable)?;
    let config = DecoderProcessConfig::from_toml(&text)
        .map_err(|error| DeviceError::DecoderFile { path: path.to_owned(), reason: error.to_string() })?;
    let folder: PathBuf = std::path::absolute(path).map_err(unreadable)?;
    let folder = folder.parent().unwrap_or(Path::new("."));
    let beside = |word: &String| match word.strip_prefix("./") {
        Some(file) => folder.join(file).display().to_string(),
        None => word.clone(),
    };
    Ok(DecoderProcessConfig { command: config.command.iter().map(beside).collect(), ..config })
}
