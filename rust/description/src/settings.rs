//! The file `arm.toml` of an arm's folder.

use crate::{DescriptionError, folder::SETTINGS_FILE};
use proact_arm::{ArmModel, ArmSettings, FixedBase, JointEntry, JointGains, Side, matches_short_name};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Furthest that a base may stand from the box, metres.
const MAX_BASE_OFFSET_M: f64 = 10.0;
/// Largest gain, SI units.
const MAX_GAIN: f64 = 1e6;

/// What may stand in the file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ArmFile {
    title: String,
    side: Side,
    aliases: Vec<String>,
    #[serde(rename = "gripper")]
    grasp_contact_links: Vec<String>,
    #[serde(rename = "cycle")]
    joint_cycle: Vec<String>,
    levels: BTreeMap<String, Vec<String>>,
    joints: Vec<JointEntry>,
    controllers: BTreeMap<String, JointGains>,
    #[serde(rename = "stand")]
    fixed_base: Option<FixedBase>,
}

/// Writes what `text` says into `model`, and checks every name against it.
///
/// # Errors
/// [`DescriptionError::Settings`] with the line, or with the name that the arm does not have.
pub(crate) fn apply(model: &mut ArmModel, text: &str) -> Result<(), DescriptionError> {
    let file: ArmFile = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        settings_error(format!("line {line}: {}", error.message().replace(['`', '\n'], " ")))
    })?;
    let names = |joints: &mut dyn Iterator<Item = usize>| -> Vec<String> {
        joints.map(|joint| model.joints[joint].name.clone()).collect()
    };
    let (arm, moving) = (names(&mut model.arm.iter().copied()), names(&mut model.moving()));
    let links: Vec<String> = model.links.iter().map(|link| link.name.clone()).collect();
    let known = |what: &str, name: &str, names: &[String]| {
        if names.iter().any(|full| matches_short_name(full, name)) {
            return Ok(());
        }
        Err(settings_error(format!(
            "{what} {name:?} is not in the arm; expected one of {}",
            names.join(", ")
        )))
    };
    for entry in &file.joints {
        known("joint", &entry.joint, &arm)?;
        if entry.we_sign.abs() != 1 {
            let (joint, sign) = (&entry.joint, entry.we_sign);
            return Err(settings_error(format!("we_sign of joint {joint:?} is {sign}, expected 1 or -1")));
        }
    }
    for name in file.joint_cycle.iter().chain(file.levels.values().flatten()) {
        known("joint", name, &arm)?;
    }
    for (name, gains) in &file.controllers {
        known("joint", name, &moving)?;
        if let Some(gain) = [gains.p, gains.d].into_iter().find(|gain| !(0.0..=MAX_GAIN).contains(gain)) {
            let expected = format!("expected 0 to {MAX_GAIN}");
            return Err(settings_error(format!("a gain of joint {name:?} is {gain}, {expected}")));
        }
    }
    for name in &file.grasp_contact_links {
        known("link", name, &links)?;
    }
    if let Some(stand) = &file.fixed_base
        && !stand.xyz.iter().all(|meters| meters.abs() <= MAX_BASE_OFFSET_M)
    {
        let got = format!("{:?}", stand.xyz.coords.as_slice());
        return Err(settings_error(format!(
            "stand.xyz is {got}, expected three numbers of -{MAX_BASE_OFFSET_M} to {MAX_BASE_OFFSET_M} m"
        )));
    }
    let ArmFile {
        title,
        side,
        grasp_contact_links: gripper,
        joint_cycle: cycle,
        levels,
        joints,
        controllers,
        fixed_base: stand,
        aliases: _,
    } = file;
    model.side = side;
    model.settings = ArmSettings {
        title,
        joint_cycle: cycle,
        levels,
        joints,
        controllers,
        grasp_contact_links: gripper,
        fixed_base: stand,
    };
    Ok(())
}

/// Former names in `text`; none if it cannot be read.
pub(crate) fn aliases(text: &str) -> Vec<String> {
    toml::from_str(text).map(|file: ArmFile| file.aliases).unwrap_or_default()
}

fn settings_error(problem: String) -> DescriptionError {
    DescriptionError::Settings { file: SETTINGS_FILE, problem }
}
