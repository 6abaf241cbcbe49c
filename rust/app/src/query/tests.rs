use super::{QueryOptions, run};
use crate::Arm;
use proact_arm::OPEN_POSE;
use serde_json::{Value, json};

/// The answers of the MPL right arm to some lines.
fn answers(lines: &str) -> Vec<Value> {
    answers_of(QueryOptions::default(), lines)
}

fn answers_of(options: QueryOptions, lines: &str) -> Vec<Value> {
    let mut output = Vec::new();
    run(options, lines.as_bytes(), &mut output).unwrap();
    let output = String::from_utf8(output).unwrap();
    output.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn answer(question: Value) -> Value {
    let mut answers = answers(&question.to_string());
    assert_eq!(answers.len(), 1);
    answers.remove(0)
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

const STRAIGHT: [f64; 7] = [0.0; 7];
const BENT: [f64; 7] = [0.6, -0.3, 0.2, 1.2, 0.3, 0.2, 0.1];

#[test]
fn forward_kinematics_answers_position_and_quaternion() {
    let answer = answer(json!({ "op": "fk", "q": STRAIGHT }));
    // Known from the original to three digits; its base leans by 0.8 mrad.
    assert!(largest_difference(&numbers(&answer["position"]), &[0.004, -0.136, -0.558]) < 1.5e-3);
    let length: f64 = numbers(&answer["quaternion"]).iter().map(|x| x * x).sum();
    assert!((length - 1.0).abs() < 1e-12);
}

#[test]
fn a_jacobian_has_six_rows_and_its_singular_values_are_those_of_condition() {
    let jacobian = answer(json!({ "op": "jacobian", "q": BENT }));
    let rows: Vec<Vec<f64>> = jacobian["jacobian"].as_array().unwrap().iter().map(numbers).collect();
    assert_eq!((rows.len(), rows[0].len()), (6, 7));
    let condition = answer(json!({ "op": "condition", "q": BENT }));
    let sigma = numbers(&condition["sigma"]);
    let squares: f64 = rows.iter().flatten().map(|x| x * x).sum();
    assert!((squares - sigma.iter().map(|s| s * s).sum::<f64>()).abs() < 1e-12);
    assert!((condition["condition"].as_f64().unwrap() - sigma[0] / sigma[5]).abs() < 1e-12);
}

#[test]
fn inverse_dynamics_feels_the_hand_and_its_default_is_zero() {
    let question = |hand: Value| {
        let mut question = json!({ "op": "inverse_dynamics", "q": BENT, "qd": STRAIGHT, "qdd": STRAIGHT });
        if !hand.is_null() {
            question["hand"] = hand;
        }
        numbers(&answer(question)["tau"])
    };
    let default = question(Value::Null);
    assert_eq!(default.len(), 7);
    assert_eq!(default, question(json!(vec![0.0; 20])));
    let mut closed = vec![0.0; 20];
    closed[1] = 1.0;
    assert!(largest_difference(&default, &question(json!(closed))) > 1e-4);
}

#[test]
fn inverse_kinematics_takes_angles_a_number_or_nothing_as_its_seed() {
    let target = answer(json!({ "op": "fk", "q": BENT }));
    for seed in [json!(BENT), json!(7), Value::Null] {
        let question = json!({ "op": "ik", "position": target["position"],
            "quaternion": target["quaternion"], "seed": seed });
        let solution = answer(question);
        assert_eq!(solution["status"], "ok");
        let reached = answer(json!({ "op": "fk", "q": solution["q"] }));
        let difference = largest_difference(&numbers(&reached["position"]), &numbers(&target["position"]));
        assert!(difference < 1.01e-8);
    }
    let far = answer(json!({ "op": "ik", "position": [2, 0, 0], "quaternion": [0, 0, 0, 1] }));
    assert_eq!(far, json!({ "status": "unreachable", "q": null }));
}

#[test]
fn a_plan_leads_from_start_to_goal_and_a_pose_is_understood_in_the_base() {
    let start = [0.0, -0.3, 0.0, 0.5, 0.0, 0.0, 0.0];
    let plan = answer(json!({ "op": "plan", "start": start, "goal_q": BENT, "scene": "empty", "seed": 1 }));
    assert_eq!(plan["status"], "ok", "{plan}");
    let path: Vec<Vec<f64>> = plan["path"].as_array().unwrap().iter().map(numbers).collect();
    assert!(largest_difference(&path[0], &start) < 1e-9);
    assert!(largest_difference(path.last().unwrap(), &BENT) < 1e-9);
    assert_eq!(numbers(&plan["times"]).len(), path.len());

    let mut goal = answer(json!({ "op": "fk", "q": BENT }));
    let plan = answer(json!({ "op": "plan", "start": start, "goal_pose": goal, "scene": "empty", "seed": 1,
        "base_pose": { "position": [1.0, 2.0, 3.0] } }));
    assert_eq!(plan["status"], "ok", "{plan}");
    let reached = answer(json!({ "op": "fk", "q": plan["path"].as_array().unwrap().last().unwrap() }));
    assert!(largest_difference(&numbers(&reached["position"]), &numbers(&goal["position"])) < 1e-3);

    goal["position"][0] = json!(3.0);
    let plan = answer(json!({ "op": "plan", "start": start, "goal_pose": goal, "scene": "empty" }));
    assert_ne!(plan["status"], "ok");
}

#[test]
fn a_plan_takes_a_planner_by_name_and_says_in_five_words_how_it_ended() {
    let plan = |more: Value| {
        let mut question = json!({
            "op": "plan", "start": [0, 0, 0, 1, 0, 0, 0], "goal_q": [0.3, -0.4, 0.2, 1.4, 0.1, 0.1, 0.1],
            "scene": "empty",
        });
        let object = question.as_object_mut().expect("an object");
        object.extend(more.as_object().expect("an object").clone());
        answer(question)
    };
    let named = plan(json!({ "planner": "BiTRRT", "parameters": { "range": 0.5 } }));
    assert_eq!((&named["status"], &named["words"]), (&json!("ok"), &json!("Ready")), "{named}");
    let unknown = plan(json!({ "planner": "Magic" }));
    assert!(unknown["error"].as_str().is_some_and(|e| e.contains("RRTConnect")), "{unknown}");
    let thing = json!({ "shape": { "type": "sphere", "radius": 0.02 }, "position": [0.0, -0.1, -0.1] });
    assert_eq!(plan(json!({ "attached": [thing] }))["status"], "ok");
    let two = plan(json!({ "attached": [thing, thing] }));
    assert!(two["error"].as_str().is_some_and(|e| e.contains("one at most")), "{two}");
}

#[test]
fn a_roadmap_is_grown_stored_and_begun_with() {
    let grown = answer(json!({ "op": "roadmap", "milestones": 60, "scene": "box", "seed": 1 }));
    assert!(grown["milestones"].as_array().is_some_and(|rows| rows.len() >= 60), "{grown}");
    let file = std::env::temp_dir().join(format!("proact-roadmap-{}.json", std::process::id()));
    let plan = |planner: &str| {
        answer(json!({ "op": "plan", "start": [1.029, -0.161, 0.1291, 1.029, 1.57, 0.0174, 0.1006],
            "goal_q": [0.729, -0.161, 0.529, 0.829, 1.57, 0.0174, 0.1006], "scene": "clutter", "planner": planner, "roadmap": file.to_str() }))
    };
    let error = |answer: Value| answer["error"].as_str().unwrap_or_default().to_owned();
    assert!(error(plan("PRM")).contains("No such file"), "a roadmap that is not there");
    std::fs::write(&file, grown.to_string()).unwrap();
    assert_eq!(plan("PRM")["status"], "ok");
    assert!(error(plan("RRTConnect")).contains("expected the planner PRM"));
    std::fs::write(&file, json!({ "milestones": [[0.0]], "edges": [] }).to_string()).unwrap();
    assert!(error(plan("PRM")).contains("milestone"), "a roadmap of another arm");
    std::fs::write(&file, "{}").unwrap();
    assert!(error(plan("PRM")).contains("missing field"));
    std::fs::remove_file(&file).unwrap();
    let none = answer(json!({ "op": "roadmap", "milestones": 0, "scene": "box" }));
    assert!(error(none).contains("expected 1 to"));
}

#[test]
fn a_mesh_collides_as_the_same_box_does_and_a_bad_one_is_refused() {
    let mesh = |triangles: Value| {
        answer(json!({
            "op": "collision", "q": [0, 0, 0, 0, 0, 0, 0],
            "scene": [{ "name": "roof", "position": [0, 0, -0.3], "shape": {
                "type": "mesh", "triangles": triangles,
                "vertices": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
            }}],
        }))
    };
    let hit = mesh(json!([[0, 1, 2], [0, 2, 3]]));
    assert_eq!(hit["collision"], true, "{hit}");
    let bad = mesh(json!([[0, 1, 9]]));
    assert!(bad["error"].as_str().is_some_and(|e| e.contains("vertex 9")), "{bad}");
    let none = mesh(json!([]));
    assert!(none["error"].as_str().is_some_and(|e| e.contains("triangle")), "{none}");
}

#[test]
fn collisions_are_named_in_every_kind_of_scene() {
    let collision = |scene: Value| answer(json!({ "op": "collision", "q": BENT, "scene": scene }));
    assert_eq!(collision(json!("empty")), json!({ "collision": false, "pairs": [] }));
    let wrist = answer(json!({ "op": "fk", "q": BENT }));
    let ball = json!([{ "name": "ball", "shape": { "type": "sphere", "radius": 0.05 },
        "position": wrist["position"] }]);
    let touching = collision(ball);
    assert_eq!(touching["collision"], true);
    assert!(touching["pairs"].to_string().contains("ball"), "{touching}");
    // With the shoulder in the table's place the arm cannot be clear of it.
    let inside = answer(json!({ "op": "collision", "q": BENT, "scene": "box",
        "base_pose": { "position": [0.0, 0.0, 1.0] } }));
    assert!(inside["pairs"].to_string().contains("table"), "{inside}");
    assert_eq!(collision(json!("clutter")).get("error"), None);
}

#[test]
fn a_bad_line_is_answered_and_the_stream_goes_on() {
    let good = json!({ "op": "fk", "q": BENT }).to_string();
    let cases: [(&str, &str); 15] = [
        ("nonsense", "expected one JSON object such as {\"op\": \"fk\""),
        ("[]", "invalid type: sequence, expected a map"),
        ("{\"q\": [0]}", "missing field `op`"),
        ("{\"op\": \"fly\"}", "unknown variant `fly`, expected one of `fk`"),
        ("{\"op\": \"fk\"}", "missing field `q`"),
        ("{\"op\": \"fk\", \"q\": [0], \"speed\": 1}", "unknown field `speed`"),
        ("{\"op\": \"fk\", \"q\": [0, 0]}", "got 2 joint values, the chain has 7 joints"),
        ("{\"op\": \"fk\", \"q\": [NaN]}", "expected value"),
        ("{\"op\": \"fk\", \"q\": [1e999]}", "number out of range"),
        (
            "{\"op\": \"inverse_dynamics\", \"q\": [0], \"qd\": [0], \"qdd\": [0]}",
            "q has 1 values, expected 7",
        ),
        // It was answered by null for each torque.
        (
            "{\"op\": \"inverse_dynamics\", \"q\": [0, 0, 0, 0, 0, 0, 0], \"qd\": [1e200, 0, 0, 0, 0, 0, 0], \
             \"qdd\": [0, 0, 0, 0, 0, 0, 0]}",
            "torque of joint 0 is beyond the range of numbers",
        ),
        (
            "{\"op\": \"ik\", \"position\": [0, 0, 0], \"quaternion\": [0, 0, 0, 2]}",
            "has length 2, expected 1",
        ),
        (
            "{\"op\": \"ik\", \"position\": [0, 0, 0], \"quaternion\": [0, 0, 0, 1], \"seed\": -1}",
            "seed is -1, expected a list of angles or a whole number from 0",
        ),
        ("{\"op\": \"collision\", \"q\": [0], \"scene\": \"moon\"}", "scene is \"moon\", expected box"),
        ("{\"op\": \"plan\", \"start\": [0], \"scene\": \"empty\"}", "expected one of goal_q and goal_pose"),
    ];
    let lines: String = cases.iter().flat_map(|(bad, _)| [bad, "\n", &good, "\n\n"]).collect();
    let answers = answers(&lines);
    assert_eq!(answers.len(), 2 * cases.len(), "one answer a line, none for empty lines");
    for ((bad, expected), pair) in cases.iter().zip(answers.chunks(2)) {
        let error = pair[0]["error"].as_str().unwrap_or_else(|| panic!("{bad} was answered: {}", pair[0]));
        assert!(error.contains(expected), "{bad}: {error}");
        assert!(pair[1]["position"].is_array());
    }
}

#[test]
fn a_line_that_is_not_utf8_is_a_bad_line_too() {
    let mut input = vec![0xff, 0xfe, b'\n'];
    input.extend(json!({ "op": "fk", "q": BENT }).to_string().bytes());
    let mut output = Vec::new();
    run(QueryOptions::default(), input.as_slice(), &mut output).unwrap();
    let output = String::from_utf8(output).unwrap();
    assert!(output.lines().next().unwrap().starts_with("{\"error\""));
    assert_eq!(output.lines().count(), 2);
}

#[test]
fn another_chain_and_another_arm_can_be_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("arm.urdf");
    std::fs::write(&file, proact_description::MPL_RIGHT_ARM_URDF).unwrap();
    let options = |tip: &str| QueryOptions {
        urdf: Some(file.clone()),
        base: Some("mpl_right_arm__humerus_link".to_owned()),
        tip: Some(tip.to_owned()),
        ..QueryOptions::default()
    };
    let question = json!({ "op": "jacobian", "q": [0.0, 0.5, 0.0] }).to_string();
    let answer = answers_of(options("mpl_right_arm__wristy_link"), &question);
    assert_eq!(answer[0]["jacobian"][0].as_array().map(Vec::len), Some(3), "{}", answer[0]);
    let error = run(options("hook"), "".as_bytes(), Vec::new()).unwrap_err();
    assert!(error.to_string().contains("hook"), "{error}");
    let missing = QueryOptions { urdf: Some(folder.path().join("none.urdf")), ..Default::default() };
    assert!(run(missing, "".as_bytes(), Vec::new()).unwrap_err().to_string().contains("none.urdf"));
}

#[test]
fn an_arm_is_asked_with_the_open_hand_of_its_srdf_and_an_incomplete_file_is_completed() {
    // The hand of the WAM opens at other angles than zero.
    let standing = QueryOptions { arm: Some("wam".to_owned()), ..QueryOptions::default() };
    let arm = Arm::load("wam").unwrap();
    let open = arm.model().pose("hand", OPEN_POSE).unwrap();
    let q = vec![0.3; arm.model().arm.len()];
    let ask = |hand: Option<&[f64]>| {
        let mut question = json!({ "op": "inverse_dynamics", "q": q, "qd": q, "qdd": q });
        if let Some(hand) = hand {
            question["hand"] = json!(hand);
        }
        answers_of(standing.clone(), &question.to_string())[0].to_string()
    };
    assert_eq!(ask(None), ask(Some(open)));
    assert_ne!(ask(None), ask(Some(&vec![0.0; open.len()])));

    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("arm.urdf");
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><mass value=\"0\"/><inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"/></inertial></link>"
        )
    };
    let joint = |k: usize| {
        format!(
            "<joint name=\"j{k}\" type=\"continuous\"><parent link=\"l{}\"/><child link=\"l{k}\"/><origin xyz=\"0 0 0.2\"/><axis xyz=\"0 1 0\"/></joint>",
            k - 1
        )
    };
    let links: String = (0..=4).map(|k| link(&format!("l{k}"))).collect();
    let joints: String = (1..=4).map(joint).collect();
    std::fs::write(&file, format!("<robot name=\"frames\">{links}{joints}</robot>")).unwrap();
    let frames = QueryOptions { urdf: Some(file), ..QueryOptions::default() };
    let answer = answers_of(frames, &json!({ "op": "fk", "q": vec![0.0; 4] }).to_string());
    assert!((answer[0]["position"][2].as_f64().unwrap() - 0.8).abs() < 1e-12, "{}", answer[0]);
}

#[test]
fn a_line_that_is_too_long_is_answered_without_being_kept_and_the_stream_goes_on() {
    use std::io::{BufReader, Read};
    let long = std::io::repeat(b'[').take(100 << 20);
    let good = format!("\n{}\n", json!({ "op": "fk", "q": BENT }));
    let mut output = Vec::new();
    run(QueryOptions::default(), BufReader::new(long.chain(good.as_bytes())), &mut output).unwrap();
    let output = String::from_utf8(output).unwrap();
    let mut lines = output.lines();
    assert!(lines.next().unwrap().contains("the line has more than 4194304 bytes"), "{output}");
    assert!(lines.next().unwrap().contains("position"), "{output}");
}

#[test]
fn a_roadmap_ends_where_no_state_is_free() {
    let roadmap = |shape: Value| {
        let scene = json!([{ "name": "rock", "shape": shape, "position": [0, 0, 0] }]);
        answer(json!({ "op": "roadmap", "milestones": 50, "scene": scene }))["error"].to_string()
    };
    let inside = roadmap(json!({ "type": "box", "size": [10, 10, 10] }));
    assert!(inside.contains("0 of 50 milestones") && inside.contains("no room"), "{inside}");
    let huge = roadmap(json!({ "type": "cylinder", "radius": 1e154, "length": 1e154 }));
    assert!(huge.contains("rock") && huge.contains("at most 1000"), "{huge}");
}

#[test]
fn a_plan_with_something_far_out_in_the_hand_is_answered() {
    for meters in [900.0, 4.294967296e9, 1e20, 1e200] {
        let far =
            json!([{ "shape": { "type": "box", "size": [0.1, 0.1, 0.1] }, "position": [meters, 0, 0] }]);
        let line = json!({ "op": "plan", "start": STRAIGHT, "goal_q": vec![0.1; 7], "scene": "empty", "attached": far });
        let answer = answer(line).to_string();
        assert!(answer.contains("\"status\"") || answer.contains("\"error\""), "{meters}: {answer}");
    }
}
