mod rate_names;

use crate::DeviceError;
use proact_emg::ImuChannel;
use proact_types::{Command, Gesture, MAX_GESTURES, MAX_TEXT_BYTES, read_text};
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    io::ErrorKind,
    path::Path,
};

/// What a folder of LibEMG says about its recordings.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Metadata {
    /// Samples per second.
    pub rate_hz: Option<f64>,
    /// Gesture of each class number; none if the folder does not say.
    pub classes: Option<BTreeMap<u32, Gesture>>,
    /// The gesture of a relaxed hand; none if the folder does not say.
    pub rest: Option<Gesture>,
    /// Channels of an inertial measurement unit, in the order of their columns.
    imu: Vec<ImuChannel>,
    /// Per file first row and number of rows that were lost and bridged.
    bridged: BTreeMap<String, Vec<[usize; 2]>>,
    /// Keys that say nothing to this program, and what they hold.
    unknown: BTreeMap<String, Value>,
}

/// A key without capitals and signs, so that `SamplingFrequency` and `sampling_frequency` are one.
fn normalize_key(key: &str) -> String {
    key.chars().filter(|letter| letter.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Files that say something: our own and LibEMG 0's, then LibEMG 2's.
const METADATA_FILES: [&str; 2] = ["metadata.json", "collection_details.json"];
/// Names that programs give to the rate, without capitals, underlines and the like: ours, LibEMG's, BIDS', MNE's, EEGLAB's and others'.
/// The first that is there counts.
const RATE_KEYS: [&str; 24] = [
    "ratehz",
    "samplingrate",
    "sampling",
    "fs",
    "rate",
    "samplingratehz",
    "samplerate",
    "sampleratehz",
    "samplingfrequency",
    "samplingfrequencyhz",
    "samplefrequency",
    "samplefrequencyhz",
    "samplingfreq",
    "samplefreq",
    "samplespersecond",
    "emgrate",
    "emgratehz",
    "emgsamplingrate",
    "emgsamplingfrequency",
    "emgfs",
    "fshz",
    "sfreq",
    "srate",
    "hz",
];
/// Keys that are read, and those in which LibEMG keeps how it prompted.
const KNOWN_KEYS: [&str; 9] =
    ["class_map", "classes", "rest", "bridged", "imu", "num_reps", "num_motions", "rep_time", "rest_time"];

impl Metadata {
    /// Reads whichever of the files is there; empty if none is.
    ///
    /// # Errors
    /// A file that is no JSON object, or has a rate or classes that cannot be.
    pub(crate) fn read(dir: &Path) -> Result<Metadata, DeviceError> {
        let mut metadata = Metadata::default();
        for name in METADATA_FILES {
            let path = dir.join(name);
            let text = match std::fs::File::open(&path).and_then(|file| read_text(file, MAX_TEXT_BYTES)) {
                Ok(text) => text,
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                Err(source) => return Err(DeviceError::Read { path, source }),
            };
            let read = Metadata::parse(&text).map_err(|reason| DeviceError::Metadata { path, reason })?;
            metadata.rate_hz = metadata.rate_hz.or(read.rate_hz);
            metadata.classes = metadata.classes.or(read.classes);
            metadata.rest = metadata.rest.or(read.rest);
            metadata.bridged.extend(read.bridged);
            metadata.imu.extend(read.imu);
            metadata.unknown.extend(read.unknown);
            let known = metadata.gestures();
            if let Some(rest) = metadata.rest.filter(|rest| !known.contains(rest)) {
                let known = known.iter().map(Gesture::as_str).collect::<Vec<_>>().join(", ");
                let reason = format!("rest is {rest}, expected one of the gestures: {known}");
                return Err(DeviceError::Metadata { path: dir.join(name), reason });
            }
        }
        Ok(metadata)
    }

    fn parse(text: &str) -> Result<Metadata, String> {
        let object: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let object = object.as_object().ok_or("expected a JSON object")?;
        let order = |key: &String| RATE_KEYS.iter().position(|known| *known == normalize_key(key));
        let mut rates: Vec<(usize, &String, f64)> = Vec::new();
        for (key, value) in object {
            if let Some(rank) = order(key) {
                let rate = value.as_f64().filter(|r| r.is_finite() && *r > 0.0);
                let rate = rate.ok_or_else(|| format!("{key} is {value}, expected a number above zero"))?;
                rates.push((rank, key, rate));
            }
        }
        rates.sort_by_key(|(rank, ..)| *rank);
        let rate_hz = rates.first().map(|(.., rate)| *rate);
        if let Some(((_, key, rate), (_, other, different))) =
            rates.first().zip(rates.iter().find(|(.., rate)| Some(*rate) != rate_hz))
        {
            return Err(format!(
                "{key} is {rate} and {other} is {different}, expected one rate: remove the wrong key"
            ));
        }
        let known = |key: &&String| order(key).is_some() || KNOWN_KEYS.contains(&key.as_str());
        let unknown =
            object.iter().filter(|(key, _)| !known(key)).map(|(key, value)| (key.clone(), value.clone()));
        let unknown = unknown.collect();
        let named = |(class, name): (Option<u32>, &Value)| match (class, name.as_str()) {
            (Some(class), Some(name)) => Ok((class, gesture_named(name)?)),
            _ => Err(format!("a class is called {name}, expected class numbers with names")),
        };
        let classes: Option<BTreeMap<u32, Gesture>> = match (object.get("class_map"), object.get("classes")) {
            (Some(Value::Object(map)), _) => Some(
                map.iter()
                    .map(|(class, name)| (class.parse().ok(), name))
                    .map(named)
                    .collect::<Result<_, _>>()?,
            ),
            (None, Some(Value::Array(names))) => {
                Some((0..).map(Some).zip(names).map(named).collect::<Result<_, _>>()?)
            }
            (None, None) => None,
            (Some(other), _) | (None, Some(other)) => {
                return Err(format!("the classes are {other}, expected numbers with names"));
            }
        };
        if let Some(classes) = &classes {
            let distinct: BTreeSet<&Gesture> = classes.values().collect();
            if distinct.len() < classes.len() {
                return Err("two classes have the same name, expected each once".to_owned());
            }
            if classes.len() > MAX_GESTURES {
                return Err(format!("there are {} classes, expected at most {MAX_GESTURES}", classes.len()));
            }
        }
        let rest = match object.get("rest") {
            None => None,
            Some(Value::String(name)) => Some(gesture_named(name)?),
            Some(other) => return Err(format!("rest is {other}, expected the name of a gesture")),
        };
        let bridged = match object.get("bridged") {
            None => BTreeMap::new(),
            Some(marks) => serde_json::from_value(marks.clone())
                .map_err(|e| format!("bridged: {e}; expected per file a list of [first row, rows]"))?,
        };
        let imu: Vec<ImuChannel> = match object.get("imu") {
            None => Vec::new(),
            Some(channels) => serde_json::from_value(channels.clone())
                .map_err(|e| format!("imu: {e}; expected a list of channels with name and unit"))?,
        };
        Ok(Metadata { rate_hz, classes, rest, bridged, imu, unknown })
    }

    /// What is said of keys that are unknown, one sentence each: not of those that hold one of `rate_names`, which are a finding.
    pub(crate) fn notes(&self, rate_names: &[String]) -> impl Iterator<Item = String> + '_ {
        let found = |key: &str| {
            let within = |name: &String| {
                name.strip_prefix(key).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            rate_names.iter().any(within)
        };
        let unknown = self.unknown.keys().filter(|key| !found(key)).collect::<Vec<_>>();
        unknown
            .into_iter()
            .map(|key| format!("the metadata has the key {key:?}, which is unknown and not used"))
    }

    /// Unknown keys, also within others, that may say the rate or the sampling interval by the words of their names.
    pub(crate) fn unknown_rate_keys(&self) -> Vec<String> {
        self.unknown.iter().flat_map(|(key, value)| rate_names::rate_names(key, value)).collect()
    }

    /// The channels of the inertial measurement unit.
    ///
    /// # Errors
    /// There are none.
    pub(crate) fn imu(&self, dir: &Path) -> Result<&[ImuChannel], DeviceError> {
        if self.imu.is_empty() { Err(self.missing_imu_error(dir)) } else { Ok(&self.imu) }
    }

    /// It names channels of an inertial measurement unit.
    pub(crate) fn has_imu(&self) -> bool {
        !self.imu.is_empty()
    }

    /// What is said of the folder `dir` without an inertial measurement unit.
    pub(crate) fn missing_imu_error(&self, dir: &Path) -> DeviceError {
        let reason = "it names no channels of an inertial measurement unit, expected a list `imu` of names and units with files \
                      R_<repetition>_C_<class>_IMU.csv; leave --imu out to train without";
        DeviceError::Metadata { path: dir.join(METADATA_FILES[0]), reason: reason.to_owned() }
    }

    /// The rows of the file `name` that were lost and bridged: first row, from 0, and number.
    ///
    /// # Errors
    /// Rows that the file of `rows` rows does not have.
    pub(crate) fn bridged(
        &self,
        path: &Path,
        name: &str,
        rows: usize,
    ) -> Result<Vec<[usize; 2]>, DeviceError> {
        let marks = self.bridged.get(name).cloned().unwrap_or_default();
        match marks.iter().find(|[first, count]| first.checked_add(*count).is_none_or(|end| end > rows)) {
            None => Ok(marks),
            Some([first, count]) => {
                let reason = format!(
                    "the metadata says that {count} rows from row {first} were lost, it has {rows} rows"
                );
                Err(DeviceError::Metadata { path: path.to_owned(), reason })
            }
        }
    }

    /// The gesture of a class number: by its name if the folder names it, else the command in the place of
    /// [`Command::ALL`].
    ///
    /// # Errors
    /// A number without a gesture.
    pub(crate) fn gesture(&self, path: &Path, class: u32) -> Result<Gesture, DeviceError> {
        let found = match &self.classes {
            Some(classes) => classes.get(&class).copied(),
            None => Command::ALL.get(class as usize).copied().map(Gesture::from),
        };
        found.ok_or_else(|| {
            let numbered = |(class, name): (u32, Gesture)| format!("{class} {name}");
            let known: Vec<String> = match &self.classes {
                Some(classes) => classes.iter().map(|(class, name)| numbered((*class, *name))).collect(),
                None => (0..).zip(Command::ALL.map(Gesture::from)).map(numbered).collect(),
            };
            DeviceError::UnknownClass { path: path.to_owned(), class, known: known.join(", ") }
        })
    }

    /// Names the classes by their numbers, and the first as that of a relaxed hand, where the folder does not say.
    pub(crate) fn name_classes(&mut self, names: &[&str]) {
        if self.classes.is_none() {
            let named = |(class, name): (u32, &&str)| Some((class, name.parse::<Gesture>().ok()?));
            let classes: BTreeMap<u32, Gesture> = (0..).zip(names).filter_map(named).collect();
            self.rest = self.rest.or(classes.get(&0).copied());
            self.classes = Some(classes);
        }
    }

    /// The gestures of the folder, in alphabetical order: those that it names, else the five.
    pub(crate) fn gestures(&self) -> Vec<Gesture> {
        let Some(classes) = &self.classes else { return Command::ALL.map(Gesture::from).into() };
        classes.values().copied().collect::<BTreeSet<_>>().into_iter().collect()
    }
}

/// The gestures of LibEMG's outputs by the file in which it keeps them, such as `collection_details.json`: an output counts
/// the classes in the order of their numbers.
///
/// # Errors
/// A file that cannot be read or names no classes.
pub fn read_class_map(path: &Path) -> Result<Vec<Gesture>, DeviceError> {
    let text = std::fs::File::open(path)
        .and_then(|file| read_text(file, MAX_TEXT_BYTES))
        .map_err(|source| DeviceError::Read { path: path.to_owned(), source })?;
    let named =
        Metadata::parse(&text).and_then(|metadata| metadata.classes.ok_or("it names no classes".to_owned()));
    let named = named.map_err(|reason| DeviceError::Metadata { path: path.to_owned(), reason })?;
    Ok(named.into_values().collect())
}

/// The gesture that a folder calls `name`: the five in any spelling, all others as they stand.
fn gesture_named(name: &str) -> Result<Gesture, String> {
    let plain = name.trim().to_lowercase().replace([' ', '-'], "_");
    if plain == "rest" {
        return Ok(Command::NoMotion.into());
    }
    match plain.parse::<Command>() {
        Ok(known) => Ok(known.into()),
        Err(_) => name.trim().parse().map_err(|error: proact_types::InvalidGesture| error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_and_classes_are_read_from_either_file() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(Metadata::read(dir.path()).unwrap(), Metadata::default());
        let details = r#"{"num_reps": 3, "classes": ["x"], "class_map": {"0": "Hand_Open", "1": "no motion", "2": "Pinch"}}"#;
        std::fs::write(dir.path().join("collection_details.json"), details).unwrap();
        std::fs::write(dir.path().join("metadata.json"), r#"{"rate_hz": 1000}"#).unwrap();
        let metadata = Metadata::read(dir.path()).unwrap();
        assert_eq!(metadata.rate_hz, Some(1000.0));
        let gesture = |class| metadata.gesture(Path::new("R_0_C_0.csv"), class);
        assert_eq!(gesture(0).unwrap(), Command::HandOpen);
        assert_eq!(gesture(1).unwrap(), Command::NoMotion);
        assert_eq!(gesture(2).unwrap().as_str(), "Pinch");
        let error = gesture(3).unwrap_err().to_string();
        assert!(
            error.contains("class 3 has no name; known are 0 hand_open, 1 no_motion, 2 Pinch"),
            "{error}"
        );
        assert_eq!(
            metadata.gestures().iter().map(|g| g.as_str()).collect::<Vec<_>>(),
            ["Pinch", "hand_open", "no_motion"]
        );
        std::fs::write(dir.path().join("metadata.json"), r#"{"rest": "Point"}"#).unwrap();
        let error = Metadata::read(dir.path()).unwrap_err().to_string();
        assert!(error.contains("rest is Point, expected one of the gestures: hand_close"), "{error}");
        std::fs::remove_file(dir.path().join("metadata.json")).unwrap();
        std::fs::write(
            dir.path().join("collection_details.json"),
            r#"{"classes": ["Open", "Lax"], "rest": "Lax"}"#,
        )
        .unwrap();
        assert_eq!(Metadata::read(dir.path()).unwrap().rest.unwrap().as_str(), "Lax");
    }

    #[test]
    fn a_list_of_names_counts_from_zero() {
        let metadata = Metadata::parse(r#"{"classes": ["Rest", "wrist-flexion"]}"#).unwrap();
        assert_eq!(metadata.gesture(Path::new("f"), 1).unwrap(), Command::WristFlexion);
        assert_eq!(metadata.gesture(Path::new("f"), 0).unwrap(), Command::NoMotion);
    }

    #[test]
    fn outputs_of_libemg_count_the_classes_in_the_order_of_their_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("collection_details.json");
        std::fs::write(&path, r#"{"class_map": {"10": "Pinch", "2": "Rest", "7": "hand open"}}"#).unwrap();
        let names: Vec<String> = read_class_map(&path).unwrap().iter().map(ToString::to_string).collect();
        assert_eq!(names, ["no_motion", "hand_open", "Pinch"]);
        std::fs::write(&path, "{}").unwrap();
        assert!(read_class_map(&path).unwrap_err().to_string().contains("it names no classes"));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        for (text, why) in [
            ("[1]", "expected a JSON object"),
            ("{", "EOF"),
            (r#"{"fs": -1}"#, "fs is -1"),
            (r#"{"rate_hz": "fast"}"#, "rate_hz is \"fast\""),
            (r#"{"classes": 5}"#, "the classes are 5"),
            (r#"{"class_map": {"x": "rest"}}"#, "expected class numbers"),
            (r#"{"class_map": {"0": 7}}"#, "a class is called 7"),
            (r#"{"class_map": {"0": ""}}"#, "expected 1 to 64 bytes"),
            (r#"{"classes": ["fist", "a\u0007b"]}"#, "expected 1 to 64 bytes"),
            (r#"{"classes": ["No motion", "rest"]}"#, "two classes have the same name"),
            (r#"{"classes": ["fist"], "rest": 3}"#, "rest is 3, expected the name"),
            (r#"{"imu": ["x"]}"#, "expected a list of channels with name and unit"),
            (r#"{"bridged": {"R_0_C_0.csv": [[1, -2]]}}"#, "expected per file a list of [first row, rows]"),
        ] {
            let error = Metadata::parse(text).unwrap_err();
            assert!(error.contains(why), "{text}: {error}");
        }
    }
}
