use crate::{ClassifierKind, EmgConfig, EmgError, EmgModel, WindowView};
use proact_types::{DegreeOfFreedom, Gesture, SimTime, WindowAnswer};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// What a process is told of each window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DecoderProcessInput {
    /// The values of [`EmgConfig::features`], feature-major.
    #[default]
    Features,
    /// The samples, less their zero levels and filtered: `[samples][channels]`, oldest first.
    Samples,
}

/// A program in the place of a classifier or a regressor, which reads and writes JSON lines (`docs/emg.md`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecoderProcessConfig {
    /// The program and its arguments. A trial that is run starts it; a replay does not.
    pub command: Vec<String>,
    /// What it is told of each window. Default: the features.
    #[serde(default)]
    pub input: DecoderProcessInput,
    /// A live window without an answer after this time has no decision, milliseconds; the tick waits for it. A batch waits
    /// for each answer. Default 20.
    #[serde(default = "default_deadline")]
    pub deadline_ms: u64,
    /// The gestures that it can tell apart, where it knows them already. Default: those of its recordings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gestures: Vec<Gesture>,
}

/// Less than half of the time between two windows of 50 ms, so that the tick does not fall behind for good.
fn default_deadline() -> u64 {
    20
}

impl DecoderProcessConfig {
    /// The contents of a file (TOML) with the keys of this type.
    ///
    /// # Errors
    /// [`EmgError::Process`] naming the line, or the key that cannot be.
    pub fn from_toml(text: &str) -> Result<DecoderProcessConfig, EmgError> {
        let config: DecoderProcessConfig = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            EmgError::Process { reason: format!("line {line}: {}", error.message().replace('`', "")) }
        })?;
        config.check()?;
        Ok(config)
    }

    pub(crate) fn check(&self) -> Result<(), EmgError> {
        let refused = |reason| Err(EmgError::Process { reason });
        if self.command.first().is_none_or(|program| program.is_empty()) {
            return refused(format!("command is {:?}, expected a program's name first", self.command));
        }
        if !(1..=1000).contains(&self.deadline_ms) {
            return refused(format!("deadline_ms is {}, expected 1 to 1000", self.deadline_ms));
        }
        Ok(())
    }
}

/// A process that decodes windows.
pub trait DecoderProcess: Send {
    /// Its answer to `line`, which is that of window number `window`.
    fn decode(&mut self, window: u64, line: &str) -> WindowAnswer;
}

/// What a process is told of one window.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecodeRequest {
    /// Counts from 1; the answer repeats it.
    pub window: u64,
    /// End of the window, milliseconds since the start of the stream or trial.
    pub time: SimTime,
    /// With [`DecoderProcessInput::Features`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub features: Option<Vec<f64>>,
    /// With [`DecoderProcessInput::Samples`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<Vec<f64>>>,
}

impl DecodeRequest {
    /// The line of a window with its `features`.
    pub fn new(
        input: DecoderProcessInput,
        window: u64,
        time: SimTime,
        view: &WindowView<'_>,
        features: &[f64],
    ) -> DecodeRequest {
        let samples = || {
            let mut rows = vec![Vec::with_capacity(view.channels()); view.length()];
            for channel in 0..view.channels() {
                rows.iter_mut().zip(view.channel(channel)).for_each(|(row, value)| row.push(value));
            }
            rows
        };
        DecodeRequest {
            window,
            time,
            features: (input == DecoderProcessInput::Features).then(|| features.to_vec()),
            samples: (input == DecoderProcessInput::Samples).then(samples),
        }
    }

    /// As JSON.
    pub fn text(&self) -> String {
        // Numbers, and lists of them: nothing that JSON cannot say.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// What a process answers to one window.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DecodeResponse {
    pub(crate) window: u64,
    #[serde(default)]
    pub(crate) posterior: Option<Vec<f64>>,
    #[serde(default)]
    pub(crate) drives: Option<Vec<f64>>,
    #[serde(default)]
    pub(crate) error: Option<String>,
}

/// The first line to a process: what it will be told, and what it is to answer. `state` is what its training gave, as JSON
/// text; empty before that.
pub fn start_request(
    config: &EmgConfig,
    gestures: &[Gesture],
    drives: &[DegreeOfFreedom],
    state: &str,
) -> Result<String, EmgError> {
    let input = config.process.as_ref().map_or(DecoderProcessInput::Features, |process| process.input);
    let state: Value = match state {
        "" => Value::Null,
        text => serde_json::from_str(text)
            .map_err(|e| EmgError::Process { reason: format!("its state is no JSON: {e}") })?,
    };
    let begin = json!({
        "gestures": gestures, "rest": config.rest, "drives": drives, "input": input,
        "features": config.column_names(), "channels": config.channels, "rate_hz": config.rate_hz,
        "samples": config.window_samples()?,
    });
    Ok(json!({ "window": 0, "begin": begin, "state": state }).to_string())
}

impl EmgConfig {
    /// Settings of the closest decoder that is none in a process: what judges recordings on the way to a process's model.
    pub fn without_process(&self) -> EmgConfig {
        let classifier = match self.classifier {
            ClassifierKind::Process => ClassifierKind::Lda,
            ClassifierKind::ProcessRegressor => ClassifierKind::Ridge,
            kind => kind,
        };
        EmgConfig { classifier, process: None, ..self.clone() }
    }
}

impl EmgModel {
    /// The same model, trained with [`EmgConfig::without_process`] of `config`, whose windows the process of `config` decodes;
    /// `state` is what it learnt, as JSON text.
    ///
    /// # Errors
    /// Settings that name no process, or gestures that are not those that it knows.
    pub fn decoded_by_process(mut self, config: &EmgConfig, state: &str) -> Result<EmgModel, EmgError> {
        self.classifier = self.classifier.decoded_by_process(config, state)?;
        self.config =
            EmgConfig { classifier: config.classifier, process: config.process.clone(), ..self.config };
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_of_a_process_has_defaults_and_names_what_cannot_be() {
        let config = DecoderProcessConfig::from_toml("command = [\"python3\", \"net.py\"]").expect("enough");
        assert_eq!((config.input, config.deadline_ms), (DecoderProcessInput::Features, 20));
        let refused = |text: &str| DecoderProcessConfig::from_toml(text).expect_err("refused").to_string();
        assert!(refused("command = []").contains("a program's name first"));
        assert!(
            refused("command = [\"a\"]\ndeadline_ms = 0").contains("deadline_ms is 0, expected 1 to 1000")
        );
        assert!(refused("command = [\"a\"]\ninput = \"sound\"").contains("line 2"));
        assert!(refused("comand = [\"a\"]").contains("comand"));
    }
}
