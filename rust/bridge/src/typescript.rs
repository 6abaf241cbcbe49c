//! Writes the TypeScript of all JSON that crosses between server and page, and finds out whether the committed file says
//! the same.

use crate::{
    CalibrationCommand, PageContent, RecordedTrial, TrackingReport, calibration_view::CalibrationMessage,
    feed::ServerMessage, input::ClientMessage, live::Role, trials::TrialSummary,
};
use std::{collections::BTreeMap, fs, path::Path};
use ts_rs::{Config, TS, TypeVisitor};

const FILE: &str = "web/src/generated/types.ts";
const HEAD: &str = "// Made from the Rust types by: UPDATE_EXPECTED=1 cargo test --release -p proact-bridge --features ts typescript
// Metres, rad, frame `world`; quaternions x, y, z, w.
";

/// Stands for a whole number of 64 bits of which nobody has said what the page gets.
const LARGE: &str = "LargeNumber";

/// Declarations by name.
struct Declarations {
    config: Config,
    by_name: BTreeMap<String, String>,
}

impl TypeVisitor for Declarations {
    fn visit<T: TS + 'static + ?Sized>(&mut self) {
        // What has no file of its own is a type of the language.
        if T::output_path().is_none() {
            return;
        }
        let text = format!("{}export {}", T::docs().unwrap_or_default(), T::decl(&self.config));
        // A comment of one line, and no spaces at the ends of lines.
        let text = text.replace("/**\n * ", "/** ").replace("\n */", " */").replace(" \n", "\n");
        match self.by_name.insert(T::ident(&self.config), text.clone()) {
            None => T::visit_dependencies(self),
            Some(before) => assert_eq!(before, text, "two types have one name"),
        }
    }
}

/// The whole file.
fn types() -> String {
    let config = Config::new().with_large_int(LARGE);
    let mut declarations = Declarations { config, by_name: BTreeMap::new() };
    declarations.visit::<PageContent>();
    declarations.visit::<TrialSummary>();
    declarations.visit::<RecordedTrial>();
    declarations.visit::<TrackingReport>();
    declarations.visit::<Role>();
    declarations.visit::<ServerMessage>();
    declarations.visit::<ClientMessage>();
    declarations.visit::<CalibrationMessage>();
    declarations.visit::<CalibrationCommand>();
    declarations.by_name.values().fold(HEAD.to_owned(), |file, text| file + "\n" + text + "\n")
}

#[test]
fn the_types_of_the_page_are_those_of_the_server() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(FILE);
    let expected = types();
    if std::env::var_os("UPDATE_EXPECTED").is_some() {
        fs::write(&path, &expected).unwrap();
    }
    let got = fs::read_to_string(&path).unwrap_or_default();
    let differs = expected.lines().zip(got.lines()).find(|(expected, got)| expected != got);
    assert!(
        got == expected,
        "rust/bridge/{FILE} is not what the Rust types give; first difference (expected, got): {differs:?}; write it \
         anew with UPDATE_EXPECTED=1 cargo test --release -p proact-bridge --features ts typescript"
    );
}

/// A page showed a seed whose last digits were others: a browser has no whole numbers above 2^53.
#[test]
fn whole_numbers_of_64_bits_are_text_or_are_known_to_stay_small() {
    let types = types();
    let line = types.lines().find(|line| line.contains(LARGE));
    assert_eq!(
        line, None,
        "a field of 64 bits goes to the page; expected text (serialize_with = encoding::as_text, ts(type = \"string\")), or \
         ts(type = \"number\") for a count that cannot reach 2^53"
    );
}

#[test]
fn a_pose_looks_as_the_page_is_told() {
    let json = serde_json::to_string(&proact_types::Pose::identity()).unwrap();
    assert_eq!(json, r#"{"rotation":[0.0,0.0,0.0,1.0],"translation":[0.0,0.0,0.0]}"#);
}
