//! The file `arm.toml` of an arm's folder.

use crate::{DescriptionError, folder::SETTINGS_FILE};
use proact_arm::{ArmModel, ArmSettings, JointEntry, JointGains, Side, Stand, is_named};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Furthest that a base may stand from the box, metres.
const FURTHEST: f64 = 10.0;
/// Largest gain, SI units.
const STRONGEST_GAIN: f64 = 1e6;

/// What may stand in the file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ArmFile {
    title: String,
    side: Side,
    aliases: Vec<String>,
    gripper: Vec<String>,
    cycle: Vec<String>,
    levels: BTreeMap<String, Vec<String>>,
    joints: Vec<JointEntry>,
    controllers: BTreeMap<String, JointGains>,
    stand: Option<Stand>,
}

/// Writes what `text` says into `model`, and checks every name against it.
///
/// # Errors
/// [`DescriptionError::Settings`] with the line, or with the name that the arm does not have.
pub(crate) fn apply(model: &mut ArmModel, text: &str) -> Result<(), DescriptionError> {
    let file: ArmFile = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        refused(format!("line {line}: {}", error.message().replace(['`', '\n'], " ")))
    })?;
    let names = |joints: &mut dyn Iterator<Item = usize>| -> Vec<String> {
        joints.map(|joint| model.joints[joint].name.clone()).collect()
    };
    let (arm, moving) = (names(&mut model.arm.iter().copied()), names(&mut model.moving()));
    let links: Vec<String> = model.links.iter().map(|link| link.name.clone()).collect();
    let known = |what: &str, name: &str, names: &[String]| {
        if names.iter().any(|full| is_named(full, name)) {
            return Ok(());
        }
        Err(refused(format!("{what} {name:?} is not in the arm; expected one of {}", names.join(", "))))
    };
    for entry in &file.joints {
        known("joint", &entry.joint, &arm)?;
        if entry.we_sign.abs() != 1 {
            let (joint, sign) = (&entry.joint, entry.we_sign);
            return Err(refused(format!("we_sign of joint {joint:?} is {sign}, expected 1 or -1")));
        }
    }
    for name in file.cycle.iter().chain(file.levels.values().flatten()) {
        known("joint", name, &arm)?;
    }
    for (name, gains) in &file.controllers {
        known("joint", name, &moving)?;
        if let Some(gain) = [gains.p, gains.d].into_iter().find(|gain| !(0.0..=STRONGEST_GAIN).contains(gain))
        {
            let expected = format!("expected 0 to {STRONGEST_GAIN}");
            return Err(refused(format!("a gain of joint {name:?} is {gain}, {expected}")));
        }
    }
    for name in &file.gripper {
        known("link", name, &links)?;
    }
    if let Some(stand) = &file.stand
        && !stand.xyz.iter().all(|metres| metres.abs() <= FURTHEST)
    {
        let got = format!("{:?}", stand.xyz.coords.as_slice());
        return Err(refused(format!(
            "stand.xyz is {got}, expected three numbers of -{FURTHEST} to {FURTHEST} m"
        )));
    }
    let ArmFile { title, side, gripper, cycle, levels, joints, controllers, stand, aliases: _ } = file;
    model.side = side;
    model.settings = ArmSettings { title, cycle, levels, joints, controllers, gripper, stand };
    Ok(())
}

/// Former names in `text`; none if it cannot be read.
pub(crate) fn aliases(text: &str) -> Vec<String> {
    toml::from_str(text).map(|file: ArmFile| file.aliases).unwrap_or_default()
}

fn refused(problem: String) -> DescriptionError {
    DescriptionError::Settings { file: SETTINGS_FILE, problem }
}
