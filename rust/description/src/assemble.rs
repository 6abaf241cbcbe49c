//! Joins the tree of links with its semantics into an [`ArmModel`].

use crate::{
    finding::{Findings, join_names, joint_location as joint_place, link_location as link_place},
    srdf::{EndEffector, Group, GroupMember, SrdfGrasp, SrdfModel},
    tree::LinkTree,
};
use proact_arm::{ArmModel, CLOSED_POSE, Grasp, JointKind, JointLimits, NamedPose, OPEN_POSE};
use proact_types::{MAX_JOINTS, Vector};

/// The model, if nothing fatal was found on the way.
pub(crate) fn assemble(
    name: &str,
    tree: LinkTree,
    semantics: Option<SrdfModel>,
    findings: &mut Findings,
) -> Option<ArmModel> {
    let moving = tree.joints.iter().filter(|j| j.kind.moves()).count();
    if moving == 0 || moving > MAX_JOINTS {
        findings.error(
            format!("robot \"{name}\""),
            "the number of moving joints is not supported",
            moving,
            format!("1 to {MAX_JOINTS}"),
            "Describe one arm with its hand.",
        );
    }
    let mut model = ArmModel {
        name: name.to_owned(),
        links: tree.links,
        joints: tree.joints,
        mimics: tree.mimics,
        arm: Vec::new(),
        hand: Vec::new(),
        tip: 0,
        poses: Vec::new(),
        allowed_collisions: Vec::new(),
        ..Default::default()
    };
    match semantics {
        Some(semantics) => apply_semantics(&mut model, &semantics, findings),
        None => infer_groups(&mut model),
    }
    allow_adjacent_links(&mut model);
    (!findings.has_error()).then_some(model)
}

/// Indices of the joints from link `base` to link `tip`; none if `tip` does not hang on `base`.
pub(crate) fn chain(model: &ArmModel, base: usize, tip: usize) -> Option<Vec<usize>> {
    let mut joints = Vec::new();
    let mut link = tip;
    while link != base {
        // Joint k moves link k + 1; the root has none.
        let joint = link.checked_sub(1)?;
        joints.push(joint);
        link = model.joints[joint].parent;
    }
    joints.reverse();
    Some(joints)
}

fn moving_joints(model: &ArmModel, joints: impl IntoIterator<Item = usize>) -> Vec<usize> {
    joints.into_iter().filter(|&j| model.joints[j].kind.moves()).collect()
}

/// Without an SRDF file: the arm runs from the base to the first body from which several joints lead on, or to its end; all
/// that follows is the hand. Links that are fixed to another one are one body with it, so frames beside the arm are no branches.
fn infer_groups(model: &mut ArmModel) {
    // The joints that move what hangs on `link`, each with what it moves; parents stand before their children.
    let body_of: Vec<usize> = (0..model.links.len()).fold(Vec::new(), |mut bodies, link| {
        let carrier = link.checked_sub(1).map(|joint| &model.joints[joint]);
        bodies.push(carrier.filter(|joint| !joint.kind.moves()).map_or(link, |joint| bodies[joint.parent]));
        bodies
    });
    let leading_on = |body: usize| {
        model.joints.iter().filter(|j| j.kind.moves() && body_of[j.parent] == body).collect::<Vec<_>>()
    };
    let mut body = 0;
    let branches = loop {
        match leading_on(body).as_slice() {
            [only] => body = only.child,
            several => break several.iter().map(|joint| joint.parent).collect::<Vec<usize>>(),
        }
    };
    // The link of that body from which all of them lead on; at the end of a chain without branches the last of a row of links.
    let above = |link: usize| {
        std::iter::successors(Some(link), |&link| link.checked_sub(1).map(|joint| model.joints[joint].parent))
    };
    let shared = |link: &usize| branches.iter().all(|&branch| above(branch).any(|other| other == *link));
    model.tip = match branches.first() {
        Some(&branch) => above(branch).find(shared).unwrap_or(body),
        None => {
            let mut last = body;
            while let [only] = model.joints.iter().filter(|j| j.parent == last).collect::<Vec<_>>().as_slice()
            {
                last = only.child;
            }
            last
        }
    };
    model.arm = moving_joints(model, chain(model, 0, model.tip).unwrap_or_default());
    let arm = &model.arm;
    model.hand = (0..model.joints.len())
        .filter(|joint| model.joints[*joint].kind.moves() && !arm.contains(joint))
        .collect();
}

fn apply_semantics(model: &mut ArmModel, semantics: &SrdfModel, findings: &mut Findings) {
    let Some((arm, hand, tip)) = roles(model, semantics, findings) else { return };
    model.arm = group_joints(model, &semantics.groups, arm, findings);
    model.hand =
        hand.map(|group| group_joints(model, &semantics.groups, group, findings)).unwrap_or_default();
    hold_other_joints(model, findings);
    let last = model.arm.last().map_or(0, |&j| model.joints[j].child);
    model.tip = match tip.map(|name| (name, model.link(name))) {
        Some((_, Ok(tip))) => tip,
        Some((name, Err(error))) => {
            let remedy = "Name an existing link as parent_link.";
            findings.error("end effector", "its parent link does not exist", name, error.to_string(), remedy);
            return;
        }
        None => last,
    };
    check_groups(model, &arm.name, findings);
    for state in &semantics.states {
        add_pose(model, state, &semantics.groups, arm, hand, findings);
    }
    for (a, b) in &semantics.allowed {
        match (model.link(a), model.link(b)) {
            (Ok(a), Ok(b)) => model.allowed_collisions.push((a.min(b), a.max(b))),
            (a_index, _) => findings.warning(
                "disable_collisions",
                "a link does not exist",
                if a_index.is_err() { a } else { b },
                "a link of the URDF",
                "Remove the pair, or correct the name.",
            ),
        }
    }
    if let Some((link, _)) = &semantics.grasp_center
        && model.links[model.tip].name != *link
    {
        findings.error(
            "grasp_centre",
            "it is given in another link than the tip",
            link,
            model.links[model.tip].name.clone(),
            "Express the point in the frame of the end effector's parent link.",
        );
    }
    add_grasps(model, semantics, findings);
}

/// The grasps, narrow objects first: their hand poses must exist.
fn add_grasps(model: &mut ArmModel, semantics: &SrdfModel, findings: &mut Findings) {
    let common =
        semantics.grasp_center.as_ref().map_or_else(Vector::zeros, |(_, center)| Vector::from(*center));
    for SrdfGrasp { grasp, has_center, location } in &semantics.grasps {
        let center = if *has_center { grasp.center } else { common };
        // A hand that is described has these two poses or cannot be used in a trial; that is said there.
        for pose in [&grasp.open_pose, &grasp.closed_pose] {
            let usual = [OPEN_POSE, CLOSED_POSE].contains(&&**pose);
            if let (false, Err(error)) = (usual, model.pose("hand", pose)) {
                findings.error(
                    location.clone(),
                    "its hand pose does not exist",
                    pose.to_string(),
                    error.to_string(),
                    "Add a group_state of this name for the hand, or name another one.",
                );
            }
        }
        model.grasps.push(Grasp { center, ..grasp.clone() });
    }
    if model.grasps.is_empty() {
        model.grasps.push(Grasp { center: common, ..Grasp::default() });
    }
    model.grasps.sort_by(|a, b| a.width_range_m[0].total_cmp(&b.width_range_m[0]));
    for pair in model.grasps.windows(2) {
        if pair[0].width_range_m[1] > pair[1].width_range_m[0] {
            findings.error(
                "grasp",
                "two grasps are for objects of the same width",
                format!("up to {} and from {} m", pair[0].width_range_m[1], pair[1].width_range_m[0]),
                "ranges that do not overlap",
                "Narrow one of the widths.",
            );
        }
    }
}

/// Arm group, hand group, and the name of the tip link.
type Roles<'a> = (&'a Group, Option<&'a Group>, Option<&'a str>);

fn roles<'a>(model: &ArmModel, semantics: &'a SrdfModel, findings: &mut Findings) -> Option<Roles<'a>> {
    let find = |name: &str| semantics.groups.iter().find(|g| g.name == name);
    let known = || join_names(semantics.groups.iter().map(|g| g.name.as_str()));
    if let Some(effector) = semantics.end_effectors.first() {
        let arm = match &effector.arm {
            Some(name) => find(name),
            None => arm_before(model, semantics, effector),
        };
        let hand = find(&effector.hand);
        if arm.is_none() || hand.is_none() {
            findings.error(
                "end effector",
                "its groups do not exist",
                format!(
                    "group \"{}\", parent_group \"{}\"",
                    effector.hand,
                    effector.arm.as_deref().unwrap_or_default()
                ),
                format!("two of the groups: {}", known()),
                "Name the hand as group and the arm as parent_group.",
            );
        }
        return Some((arm?, Some(hand?), Some(effector.tip.as_str())));
    }
    match semantics.groups.as_slice() {
        [only] => Some((only, None, None)),
        _ => {
            findings.error(
                "SRDF",
                "it is not clear which group is the arm",
                known(),
                "one group, or an <end_effector> that names arm and hand",
                "Add <end_effector name group parent_link parent_group>.",
            );
            None
        }
    }
}

/// The group whose joints lead to the end effector, where it does not say which: of those that move nothing else the one with
/// most joints.
fn arm_before<'a>(model: &ArmModel, semantics: &'a SrdfModel, effector: &EndEffector) -> Option<&'a Group> {
    let path = chain(model, 0, model.link(&effector.tip).ok()?)?;
    let mut unheard = Findings::default();
    let mut best: Option<(usize, &Group)> = None;
    for group in semantics.groups.iter().filter(|group| group.name != effector.hand) {
        let joints = group_joints(model, &semantics.groups, group, &mut unheard);
        if joints.iter().all(|joint| path.contains(joint))
            && best.is_none_or(|(count, _)| joints.len() > count)
        {
            best = Some((joints.len(), group));
        }
    }
    best.filter(|(count, _)| *count > 0).map(|(_, group)| group)
}

/// Joints that belong to no group stand at zero, or at the nearest of their limits.
fn hold_other_joints(model: &mut ArmModel, findings: &mut Findings) {
    for index in 0..model.joints.len() {
        let follows = model.mimics.iter().any(|mimic| mimic.joint == index);
        let joint = &model.joints[index];
        if !joint.kind.moves() || model.arm.contains(&index) || model.hand.contains(&index) {
            continue;
        }
        // A follower of a finger is part of the hand, whether it is listed or not.
        if follows
            && model.mimics.iter().any(|mimic| mimic.joint == index && model.hand.contains(&mimic.master))
        {
            model.hand.push(index);
            continue;
        }
        let at = 0.0_f64.clamp(joint.limits.lower, joint.limits.upper);
        findings.warning(
            joint_place(&joint.name),
            "the joint is in no group",
            "it moves",
            "a place in the arm's group or in the hand's",
            format!("It is held at {at} {}.", joint.kind.unit()),
        );
        let origin = joint.transform_at(at);
        let joint = &mut model.joints[index];
        (joint.origin, joint.kind, joint.limits) = (origin, JointKind::Fixed, JointLimits::default());
        model.mimics.retain(|mimic| mimic.joint != index && mimic.master != index);
    }
}

fn group_joints(model: &ArmModel, groups: &[Group], group: &Group, findings: &mut Findings) -> Vec<usize> {
    let mut joints = Vec::new();
    add_group_joints(model, groups, group, &mut vec![&group.name], &mut joints, findings);
    // Other readers allow fixed joints in groups; they have no place in a joint vector. A chain and its links name a joint twice.
    let mut seen = Vec::new();
    joints.retain(|joint| {
        !seen.contains(joint) && {
            seen.push(*joint);
            true
        }
    });
    moving_joints(model, joints)
}

/// The joints of `group` and of the groups in it; `path` holds the names of those that it is in.
fn add_group_joints<'a>(
    model: &ArmModel,
    groups: &'a [Group],
    group: &'a Group,
    path: &mut Vec<&'a str>,
    out: &mut Vec<usize>,
    findings: &mut Findings,
) {
    let location = format!("group \"{}\"", group.name);
    for member in &group.members {
        match member {
            GroupMember::Link(name) => match model.link(name) {
                // The root is moved by no joint.
                Ok(link) => out.extend(link.checked_sub(1)),
                Err(error) => {
                    let remedy = "Correct the name, or take the link out of the group.";
                    findings.error(&location, "a link does not exist", name, error.to_string(), remedy);
                }
            },
            GroupMember::Group(name) => match groups.iter().find(|other| other.name == *name) {
                Some(other) if !path.contains(&name.as_str()) => {
                    path.push(name);
                    add_group_joints(model, groups, other, path, out, findings);
                    path.pop();
                }
                Some(_) => {
                    let remedy = "Take one out of the other.";
                    findings.error(&location, "a group is in itself", name, "groups within groups", remedy);
                }
                None => {
                    let known = join_names(groups.iter().map(|group| group.name.as_str()));
                    findings.error(&location, "a group does not exist", name, known, "Correct the name.");
                }
            },
            GroupMember::Joint(name) => match model.joint(name) {
                Ok(joint) => out.push(joint),
                Err(error) => {
                    let remedy = "Correct the name, or take the joint out of the group.";
                    findings.error(&location, "a joint does not exist", name, error.to_string(), remedy);
                }
            },
            GroupMember::Chain { base, tip } => {
                let ends = model.link(base).ok().zip(model.link(tip).ok());
                match ends.and_then(|(base, tip)| chain(model, base, tip)) {
                    Some(joints) => out.extend(joints),
                    None => findings.error(
                        &location,
                        "the chain does not exist",
                        format!("from \"{base}\" to \"{tip}\""),
                        "two links, the second hanging on the first",
                        "Correct base_link and tip_link.",
                    ),
                }
            }
        }
    }
}

/// Every moving joint belongs to one group, and the arm is a chain that ends at the tip.
fn check_groups(model: &ArmModel, arm: &str, findings: &mut Findings) {
    for (index, joint) in model.joints.iter().enumerate() {
        let uses = model.arm.iter().chain(&model.hand).filter(|&&j| j == index).count();
        if joint.kind.moves() && uses != 1 {
            findings.error(
                joint_place(&joint.name),
                "the joint must belong to one group, once",
                format!("{uses} places in arm and hand"),
                "1",
                "List each moving joint once, either in the arm's group or in the hand's, or make it fixed.",
            );
        }
    }
    for mimic in &model.mimics {
        if [mimic.joint, mimic.master].iter().any(|joint| !model.hand.contains(joint)) {
            let got = format!("it follows {}", joint_place(&model.joints[mimic.master].name));
            findings.error(
                joint_place(&model.joints[mimic.joint].name),
                "a joint of the arm cannot be coupled",
                got,
                "two joints of the hand",
                "List both joints in the hand's group, or remove <mimic>.",
            );
        }
    }
    let path = chain(model, 0, model.tip).map(|joints| moving_joints(model, joints)).unwrap_or_default();
    if path != model.arm {
        let names = |joints: &[usize]| join_names(joints.iter().map(|&j| model.joints[j].name.as_str()));
        findings.error(
            format!("group \"{arm}\""),
            format!("the arm is not the chain from the base to {}", link_place(&model.links[model.tip].name)),
            names(&model.arm),
            names(&path),
            "List the joints of that chain, base to tip.",
        );
    }
}

fn add_pose(
    model: &mut ArmModel,
    state: &crate::srdf::GroupState,
    groups: &[Group],
    arm: &Group,
    hand: Option<&Group>,
    findings: &mut Findings,
) {
    let location = format!("pose \"{}\" of group \"{}\"", state.name, state.group);
    let roles = if state.group == arm.name {
        vec![("arm", model.arm.clone())]
    } else if hand.is_some_and(|h| h.name == state.group) {
        vec![("hand", model.hand.clone())]
    } else if let Some(group) = groups.iter().find(|group| group.name == state.group) {
        // A group of both: each takes what is its own.
        let joints = group_joints(model, groups, group, findings);
        let of = |own: &[usize]| own.iter().any(|joint| joints.contains(joint));
        let both = [("arm", model.arm.clone()), ("hand", model.hand.clone())];
        both.into_iter().filter(|(role, own)| of(own) && model.pose(role, &state.name).is_err()).collect()
    } else {
        Vec::new()
    };
    if roles.is_empty() {
        let expected = "the arm's or the hand's group";
        let remedy = "The pose is left out.";
        findings.warning(location, "its group has no role", &state.group, expected, remedy);
        return;
    }
    for (name, _) in &state.values {
        if !roles.iter().flat_map(|(_, joints)| joints).any(|&j| model.joints[j].name == *name) {
            let names = roles.iter().flat_map(|(_, joints)| joints).map(|&j| model.joints[j].name.as_str());
            let (expected, remedy) = (join_names(names), "The angle is left out.");
            findings.warning(&location, "a joint is not in the group", name, expected, remedy);
        }
    }
    for (role, joints) in roles {
        let given = |joint: &usize| state.values.iter().any(|(name, _)| *name == model.joints[*joint].name);
        if !joints.iter().any(given) {
            continue;
        }
        let mut angles = Vec::new();
        for &j in &joints {
            let joint = &model.joints[j];
            let limits = &joint.limits;
            let angle = pose_angle(model, j, &state.values).unwrap_or_else(|| {
                let at = 0.0_f64.clamp(limits.lower, limits.upper);
                let done = format!("It is {at} {}.", joint.kind.unit());
                findings.warning(&location, "an angle is missing", "nothing", joint_place(&joint.name), done);
                at
            });
            if angle < limits.lower || angle > limits.upper {
                let unit = joint.kind.unit();
                findings.warning(
                    &location,
                    format!("the angle of {} is out of its limits", joint_place(&joint.name)),
                    format!("{angle} {unit}"),
                    format!("{} to {} {unit}", limits.lower, limits.upper),
                    "Correct the pose; a program that moves there will stop at the limit.",
                );
            }
            angles.push(angle);
        }
        model.poses.push(NamedPose { name: state.name.clone(), group: role.to_owned(), angles });
    }
}

/// The angle of a joint among those of a pose, rad: what its master's makes it if it follows one, else its own.
fn pose_angle(model: &ArmModel, joint: usize, values: &[(String, f64)]) -> Option<f64> {
    let given = |joint: usize| {
        values.iter().find(|(name, _)| *name == model.joints[joint].name).map(|(_, angle)| *angle)
    };
    let follow = || {
        let mimic = model.mimics.iter().find(|mimic| mimic.joint == joint)?;
        Some(mimic.multiplier * given(mimic.master)? + mimic.offset)
    };
    follow().or_else(|| given(joint))
}

/// Neighbours touch at their joint. Every pair appears once, smaller index first, in order.
fn allow_adjacent_links(model: &mut ArmModel) {
    let neighbors = model.joints.iter().map(|j| (j.parent.min(j.child), j.parent.max(j.child)));
    model.allowed_collisions.extend(neighbors);
    model.allowed_collisions.sort_unstable();
    model.allowed_collisions.dedup();
}
