//! What stands where: the scenes of the tasks that ship, their mirror images, and files that are refused.

use proact_tasks::{Arrangement, BUILT_IN_TASKS, ModifiedBbt, Task, TaskError, TaskFile, TaskSpec};
use proact_types::{Briefing, Destination, ObjectId, Order, PlaceRegion, Point, Pose, Scene, Shape};

/// A task of two cubes, for one change at a time.
const SMALL: &str = r#"name = "small"
rules = "targets"
due = "next"
order = ["b", "a"]

[briefing]
title = "Small"
text = "Carry both cubes across."
order = "prescribed"
destination = "own_target"
score_name = "cubes on target"
most = 2
practice_secs = 0.0
limit_secs = 60.0

[scene]
table_height = 1.0
put_down = { min = [-0.1, 0.02], max = [0.1, 0.2] }

[[scene.fixed]]
name = "table"
shape = { type = "box", size = [0.4, 0.8, 0.1] }
at = [0.0, 0.0, 0.95]
friction = 0.4

[[scene.objects]]
name = "a"
at = [0.05, -0.1]
target = [0.05, 0.1]
colour = [1.0, 0.0, 0.0]
shape = { type = "box", size = [0.025, 0.025, 0.025] }
mass = 0.01
friction = 0.4
friction_finger = 0.8

[[scene.objects]]
name = "b"
at = [-0.05, -0.1]
target = [-0.05, 0.1]
colour = [0.0, 0.0, 1.0]
shape = { type = "box", size = [0.025, 0.025, 0.025] }
mass = 0.01
friction = 0.4
friction_finger = 0.8
"#;

fn shipped(name: &str, left: bool) -> Box<dyn Task> {
    TaskSpec::named(name, 1).expect("it ships").build(left).expect("a good task")
}

fn modified(number: usize) -> Scene {
    let arrangement = Arrangement::numbered(number).expect("1 to 24");
    let choice =
        TaskSpec { arrangement: Some(arrangement), ..TaskSpec::named("modified_bbt", 1).expect("it ships") };
    choice.build(false).expect("a good task").scene().clone()
}

/// The text of `SMALL` with `old` replaced, which must stand there once.
fn changed(old: &str, new: &str) -> String {
    assert_eq!(SMALL.matches(old).count(), 1, "{old:?} stands once in the text");
    SMALL.replace(old, new)
}

/// Why `text` is refused: one sentence on one line.
fn refusal(text: String) -> String {
    let error = TaskSpec::from_text(text).expect_err("it cannot be").to_string();
    assert!(!error.contains('\n') && error.len() < 300, "one sentence: {error}");
    error
}

#[test]
fn the_modified_scene_is_bit_for_bit_that_of_the_release_before_tasks_were_files() {
    let scene = modified(1);
    let fixed: Vec<_> =
        scene.fixed.iter().map(|body| (&*body.name, body.shape, body.pose, body.friction)).collect();
    let cuboid = |name, size: [f64; 3], [x, y, z]: [f64; 3]| {
        (name, Shape::Box { size }, Pose::translation(x, y, z), 0.4)
    };
    let leg = |name, x, y| {
        (name, Shape::Cylinder { radius: 0.02, length: 0.985 }, Pose::translation(x, y, 0.4925), 0.4)
    };
    assert_eq!(
        fixed,
        [
            cuboid("table", [0.31, 0.61, 0.03], [0.0, 0.0, 1.0]),
            cuboid("partition", [0.30, 0.005, 0.152], [0.0, 0.0, 1.091]),
            cuboid("wall_left", [0.31, 0.005, 0.085], [0.0, 0.3025, 1.0575]),
            cuboid("wall_right", [0.31, 0.005, 0.085], [0.0, -0.3025, 1.0575]),
            cuboid("wall_far", [0.005, 0.60, 0.085], [0.1525, 0.0, 1.0575]),
            cuboid("wall_near", [0.005, 0.60, 0.085], [-0.1525, 0.0, 1.0575]),
            leg("leg_far_left", 0.13, 0.28),
            leg("leg_far_right", 0.13, -0.28),
            leg("leg_near_left", -0.13, 0.28),
            leg("leg_near_right", -0.13, -0.28),
            cuboid("floor", [6.0, 6.0, 0.1], [0.0, 0.0, -0.05]),
        ]
    );
    let blocks: Vec<_> = scene
        .objects
        .iter()
        .map(|o| (&*o.name, o.shape, o.mass, o.friction, o.finger_friction, o.pose))
        .collect();
    let block = |name, x, y| {
        let shape = Shape::Cylinder { radius: 0.025, length: 0.05 };
        (name, shape, 0.1, 0.4, 0.8, Pose::translation(x, y, 1.015 + 0.05 / 2.0))
    };
    assert_eq!(
        blocks,
        [
            block("red1", 0.058, -0.2083),
            block("red2", 0.058, -0.092),
            block("blue1", -0.058, -0.2083),
            block("blue2", -0.058, -0.092),
        ]
    );
    let targets: Vec<_> = scene.targets.iter().map(|t| (t.object, t.center, t.radius)).collect();
    let target = |object, x, y| (ObjectId(object), Point::new(x, y, 1.015), 0.05);
    assert_eq!(
        targets,
        [
            target(0, 0.058, 0.2083),
            target(1, -0.058, 0.092),
            target(2, 0.058, 0.092),
            target(3, -0.058, 0.2083)
        ]
    );
    assert_eq!(scene.table_height, 1.015);
    assert_eq!(scene.place_region, PlaceRegion { min: [-0.125, 0.0275], max: [0.125, 0.275] });
}

/// Where the objects stand, in `world`, from above.
fn places(scene: &Scene) -> Vec<[f64; 2]> {
    scene.objects.iter().map(|o| [o.pose.translation.x, o.pose.translation.y]).collect()
}

#[test]
fn an_arrangement_moves_the_blocks_and_nothing_else() {
    let first = modified(1);
    let sorted = |scene: &Scene| {
        let mut positions = places(scene);
        positions.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
        positions
    };
    for number in 2..=24 {
        let scene = modified(number);
        assert_ne!(scene.objects, first.objects, "arrangement {number}");
        assert_eq!((&scene.fixed, &scene.targets), (&first.fixed, &first.targets));
        assert_eq!(sorted(&scene), sorted(&first), "arrangement {number}");
    }
    // Far lateral, near medial, near lateral, far medial.
    let file = ModifiedBbt::file("FL,NM,NL,FM".parse().expect("an arrangement")).expect("it ships");
    let scene = file.build(false).expect("a good task").scene().clone();
    assert_eq!(places(&scene), [[0.058, -0.2083], [-0.058, -0.092], [-0.058, -0.2083], [0.058, -0.092]]);
}

#[test]
fn what_objects_of_the_modified_task_are_called_painted_and_coloured() {
    let scene = modified(1);
    let appearances: Vec<_> = scene.objects.iter().map(|o| (&*o.ros_name, &*o.label, o.color)).collect();
    let (red, blue) = ([0.784, 0.267, 0.173], [0.133, 0.392, 0.722]);
    assert_eq!(
        appearances,
        [
            ("redcylinder1", "1", red),
            ("redcylinder2", "2", red),
            ("bluecylinder1", "1", blue),
            ("bluecylinder2", "2", blue),
        ]
    );
}

#[test]
fn the_targeted_task_has_sixteen_numbered_cubes_each_with_its_target_across_the_partition() {
    let task = shipped("targeted_bbt", false);
    let scene = task.scene();
    assert_eq!((scene.objects.len(), scene.targets.len()), (16, 16));
    for (k, object) in scene.objects.iter().enumerate() {
        assert_eq!((&*object.name, &*object.label), (&*format!("cube{}", k + 1), &*(k + 1).to_string()));
        assert_eq!(object.shape, Shape::Box { size: [0.025; 3] });
        let (at, target) = (object.pose.translation, scene.target(ObjectId::new(k)).expect("each has one"));
        assert_eq!([target.center.x, target.center.y, target.center.z], [at.x, -at.y, scene.table_height]);
        assert_eq!(at.z, scene.table_height + 0.0125, "it rests on the table");
        // 4 x 4, 55 mm apart: row by row, the nearest row first, the most lateral of a row first.
        let expected = [(k / 4) as f64 * 0.055 - 0.0825, (k % 4) as f64 * 0.055 - 0.0825 - 0.13175];
        assert!((0..2).all(|i| (at.vector[i] - expected[i]).abs() < 1e-12), "cube {}: {at}", k + 1);
    }
}

#[test]
fn the_box_of_the_tests_with_cubes_has_the_dimensions_of_their_source() {
    for name in ["targeted_bbt", "bbt"] {
        let task = shipped(name, false);
        let body = |name: &str| {
            let body = task.scene().fixed.iter().find(|b| b.name == name).expect("a part of the box");
            let Shape::Box { size } = body.shape else { panic!("{name} is a box") };
            (size, body.pose.translation.vector)
        };
        let near = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-12, "{got}, not {expected}");
        // 53.7 cm wide and 25.4 cm deep outside, sides 8.5 cm and partition 15.2 cm high.
        let ((left, left_at), (right, right_at)) = (body("wall_left"), body("wall_right"));
        near(left_at.y + left[1] / 2.0 - (right_at.y - right[1] / 2.0), 0.537);
        let ((far, far_at), (front, front_at)) = (body("wall_far"), body("wall_near"));
        near(far_at.x + far[0] / 2.0 - (front_at.x - front[0] / 2.0), 0.254);
        for (size, at) in [(left, left_at), (right, right_at), (far, far_at), (front, front_at)] {
            near(size[2], 0.085);
            near(at.z - size[2] / 2.0, task.scene().table_height);
        }
        let (partition, at) = body("partition");
        near(partition[2], 0.152);
        near(at.z - partition[2] / 2.0, task.scene().table_height);
        near(at.y, 0.0);
    }
    assert_eq!(shipped("bbt", false).scene().objects.len(), 20);
    assert!(shipped("bbt", false).scene().targets.is_empty());
}

#[test]
fn the_scene_for_the_left_hand_is_the_mirror_image() {
    for (name, _) in BUILT_IN_TASKS {
        let (right, left) = (shipped(name, false), shipped(name, true));
        let (right, left) = (right.scene(), left.scene());
        let mirrored = |pose: &Pose| {
            assert_eq!(pose.rotation, Pose::identity().rotation, "all stand along the axes");
            Pose::translation(pose.translation.x, -pose.translation.y, pose.translation.z)
        };
        let mut expected = right.clone();
        expected.fixed.iter_mut().for_each(|body| body.pose = mirrored(&body.pose));
        expected.objects.iter_mut().for_each(|object| object.pose = mirrored(&object.pose));
        expected.targets.iter_mut().for_each(|target| target.center.y = -target.center.y);
        let PlaceRegion { min, max } = right.place_region;
        expected.place_region = PlaceRegion { min: [min[0], -max[1]], max: [max[0], -min[1]] };
        assert_eq!(*left, expected, "{name}");
        // What goes over the partition begins at the right; what goes from place to place may stand anywhere.
        let crosses = name.contains("bbt");
        let at_right = right.objects.iter().all(|o| o.pose.translation.y < 0.0) && min[1] > 0.0;
        assert_eq!(at_right, crosses, "{name}");
    }
}

#[test]
fn the_text_of_a_task_survives_being_written_and_read() {
    let mut files: Vec<TaskFile> = BUILT_IN_TASKS
        .iter()
        .map(|(name, _)| TaskSpec::named(name, 1).and_then(|choice| choice.task_file()).expect("it ships"))
        .collect();
    files.push(TaskFile::read(SMALL).expect("a task"));
    for file in files {
        let text = toml::to_string(&file).expect("writes");
        let read = TaskFile::read(&text).expect("reads");
        assert_eq!(read, file);
        let (a, b) = (file.build(false).expect("a task"), read.build(false).expect("a task"));
        assert_eq!((a.scene(), a.briefing(), a.state()), (b.scene(), b.briefing(), b.state()));
    }
}

#[test]
fn a_labs_own_task_is_its_text_and_keeps_it_in_the_configuration() {
    let choice = TaskSpec::from_text(SMALL.to_owned()).expect("a task");
    let written = serde_json::to_string(&choice).expect("writes");
    let read: TaskSpec = serde_json::from_str(&written).expect("reads");
    assert_eq!(read, choice);
    let task = read.build(false).expect("a task");
    assert_eq!(places(task.scene()), [[0.05, -0.1], [-0.05, -0.1]]);
    let Briefing { title, order, destination, limit_secs, .. } = task.briefing();
    assert_eq!(
        (&**title, *order, *destination, *limit_secs),
        ("Small", Order::Prescribed, Destination::OwnTarget, 60.0)
    );
    assert_eq!(task.state().next_object, Some(ObjectId(1)), "b comes first");
    assert_eq!(read.limit_secs(), Ok(60.0));
    let shorter = read.build_with_limit(false, Some(5.0)).expect("a task");
    assert_eq!(shorter.briefing().limit_secs, 5.0);
}

#[test]
fn objects_that_overlap_or_stand_on_nothing_are_refused_by_name() {
    let error = refusal(changed("at = [-0.05, -0.1]", "at = [0.06, -0.11]"));
    assert_eq!(error, "the task's scene: \"b\" overlaps \"a\" at the start; expected room between them");
    // Cubes that touch side by side do not overlap; a tenth of a millimetre less than that does.
    let beside = |x: f64| changed("at = [-0.05, -0.1]", &format!("at = [{x}, -0.1]"));
    TaskSpec::from_text(beside(0.05 - 0.025)).expect("they touch");
    assert!(refusal(beside(0.05 - 0.0248)).contains("overlaps"));
    let wall = "[[scene.fixed]]\nname = \"wall\"\nshape = { type = \"box\", size = [0.1, 0.01, 0.1] }\n\
                at = [0.05, -0.1, 1.05]\nfriction = 0.4\n\n[[scene.objects]]\nname = \"a\"";
    let error = refusal(changed("[[scene.objects]]\nname = \"a\"", wall));
    assert!(error.starts_with("the task's scene: \"a\" overlaps \"wall\" at the start"), "{error}");
    let error = refusal(changed("at = [-0.05, -0.1]", "at = [-0.3, -0.1]"));
    assert!(
        error.starts_with("the task's scene: \"b\" at [-0.3, -0.1] stands on nothing; expected"),
        "{error}"
    );
}

#[test]
fn round_objects_overlap_by_their_radii_and_not_by_the_boxes_around_them() {
    // Two cylinders whose boxes share a corner, 0.035 m apart: that is more than twice 0.0125 m and less than twice 0.02 m.
    let text = |radius: f64| {
        let cylinder = format!("shape = {{ type = \"cylinder\", radius = {radius}, length = 0.05 }}");
        let near = changed("at = [-0.05, -0.1]", "at = [0.026, -0.124]");
        near.replace("shape = { type = \"box\", size = [0.025, 0.025, 0.025] }", &cylinder)
    };
    TaskSpec::from_text(text(0.0165)).expect("0.0339 m apart, and 0.033 m are enough");
    assert!(refusal(text(0.0175)).contains("overlaps"));
}

#[test]
fn a_target_out_of_the_box_is_refused_with_what_is_the_box() {
    let error = refusal(changed("target = [-0.05, 0.1]", "target = [-0.05, 0.3]"));
    assert_eq!(
        error,
        "the task's scene: the target of \"b\" at [-0.05, 0.3] is out of the box: expected it within put_down, \
         [-0.1, 0.02] to [0.1, 0.2]"
    );
}

#[test]
fn a_name_twice_an_empty_one_and_one_that_ships_are_refused() {
    let error = refusal(changed("name = \"b\"", "name = \"a\""));
    assert_eq!(error, "the task's scene: two bodies are called \"a\", expected different names");
    let error = refusal(changed("name = \"b\"", "name = \"table\""));
    assert_eq!(error, "the task's scene: two bodies are called \"table\", expected different names");
    assert!(refusal(changed("name = \"b\"", "name = \"\"")).contains("a body is called \"\""));
    assert!(refusal(changed("name = \"small\"", "name = \"\"")).contains("the task's name: \"\""));
    let error = refusal(changed("name = \"small\"", "name = \"bbt\""));
    assert_eq!(error, "the task's name: \"bbt\" ships with the program; expected a name of its own");
}

#[test]
fn an_unknown_key_is_refused_with_its_line_wherever_it_stands() {
    for (old, new, line) in [
        ("due = \"next\"", "duo = \"next\"", "line 3: "),
        ("title = \"Small\"", "title = \"Small\"\nsubtitle = \"x\"", "line 8: "),
        ("table_height = 1.0", "table_height = 1.0\nchair_height = 0.5", "line 18: "),
        ("at = [0.0, 0.0, 0.95]", "at = [0.0, 0.0, 0.95]\nturn = 0.0", "line 24: "),
        ("at = [-0.05, -0.1]", "at = [-0.05, -0.1]\ntarget_radus = 0.01", "scene.objects: "),
    ] {
        let key = new.lines().last().and_then(|line| line.split(' ').next()).expect("a key");
        let error = refusal(changed(old, new));
        assert!(error.starts_with(&format!("the task is unreadable: {line}unknown field {key}")), "{error}");
    }
    let grid = "[[scene.grids]]\nname = \"c\"\ncount = [1, 1]\npitch = [0.05, 0.05]\nmiddle = [0.0, -0.2]\nturn = 0.1\n\
                colour = [0.0, 1.0, 0.0]\nshape = { type = \"sphere\", radius = 0.01 }\nmass = 0.01\nfriction = 0.4\n\
                friction_finger = 0.8\n";
    let error = refusal(format!("{SMALL}\n{grid}"));
    assert!(
        error.starts_with("the task is unreadable: scene.grids: unknown field turn, expected one of"),
        "{error}"
    );
    assert!(refusal("objects".to_owned()).starts_with("the task is unreadable: line 1: "));
}

#[test]
fn a_wrong_order_is_refused() {
    let order = |names: &str| refusal(changed("order = [\"b\", \"a\"]", &format!("order = {names}")));
    assert_eq!(order("[\"b\", \"c\"]"), "the task's order: \"c\" is no object; expected a, b");
    assert_eq!(order("[\"b\", \"b\"]"), "the task's order: \"b\" stands there twice");
    assert_eq!(order("[\"b\"]"), "the task's order: 1 names, expected all 2 objects, or none");
    let none = TaskSpec::from_text(changed("order = [\"b\", \"a\"]", "order = []")).expect("as in the scene");
    assert_eq!(none.build(false).expect("a task").state().next_object, Some(ObjectId(0)));
}

#[test]
fn numbers_that_are_none_or_out_of_range_are_refused_by_name() {
    for (old, new, why) in [
        ("at = [-0.05, -0.1]", "at = [nan, -0.1]", "at of \"b\" is NaN, expected -20 to 20"),
        ("target = [-0.05, 0.1]", "target = [-0.05, inf]", "at of \"b\" is inf, expected -20 to 20"),
        ("table_height = 1.0", "table_height = nan", "table_height is NaN, expected 0 to 3"),
        ("min = [-0.1, 0.02]", "min = [0.2, 0.02]", "put_down.max[0] is 0.1, expected 0.2 to 20"),
        ("at = [0.0, 0.0, 0.95]", "at = [0.0, nan, 0.95]", "at of \"table\" is NaN, expected -20 to 20"),
        (
            "size = [0.4, 0.8, 0.1]",
            "size = [0.4, -0.8, 0.1]",
            "a length of \"table\" is -0.8, expected 0.0001 to 20",
        ),
        ("colour = [0.0, 0.0, 1.0]", "colour = [0.0, 0.0, 255.0]", "colour of \"b\" is 255, expected 0 to 1"),
    ] {
        assert_eq!(refusal(changed(old, new)), format!("the task's scene: {why}"));
    }
    for (key, bad, why) in [
        ("mass", "0.0", "mass of \"a\" is 0, expected 0.001 to 20"),
        ("friction_finger", "-1.0", "friction_finger of \"a\" is -1, expected 0 to 10"),
        ("target_radius", "nan", "target_radius of \"a\" is NaN, expected 0.001 to 1"),
    ] {
        let kept: Vec<&str> = SMALL.lines().filter(|line| !line.starts_with(&format!("{key} ="))).collect();
        let text = kept.join("\n").replace("colour = [1.0", &format!("{key} = {bad}\ncolour = [1.0"));
        let text = text.replace("colour = [0.0", &format!("{key} = 0.5\ncolour = [0.0"));
        assert_eq!(refusal(text), format!("the task's scene: {why}"));
    }
}

#[test]
fn a_scene_without_objects_or_with_too_many_is_refused_before_it_is_made() {
    let grid = |count: &str| {
        format!(
            "[[scene.grids]]\nname = \"c\"\ncount = {count}\npitch = [0.05, 0.05]\nmiddle = [0.0, -0.2]\n\
             colour = [0.0, 1.0, 0.0]\nshape = {{ type = \"sphere\", radius = 0.01 }}\nmass = 0.01\nfriction = 0.4\n\
             friction_finger = 0.8\n"
        )
    };
    let error = refusal(format!("{SMALL}\n{}", grid("[100, 100]")));
    assert_eq!(error, "the task's scene: 10002 objects, expected 1 to 512");
    // Numbers whose products and sums do not fit.
    let grid_file = grid("[9223372036854775807, 9223372036854775807]");
    let error = refusal(format!("{SMALL}\n{grid_file}\n{grid_file}"));
    assert!(error.ends_with("objects, expected 1 to 512"), "{error}");
    let end = SMALL.find("[[scene.objects]]").expect("it has objects");
    let none = SMALL[..end].replace("order = [\"b\", \"a\"]\n", "");
    assert_eq!(refusal(none), "the task's scene: 0 objects, expected 1 to 512");
}

#[test]
fn rules_that_do_not_fit_are_refused() {
    for (old, new, why) in [
        ("limit_secs = 60.0", "limit_secs = 0.0", "briefing.limit_secs: 0, expected 0.001 to 3600"),
        ("limit_secs = 60.0", "limit_secs = nan", "briefing.limit_secs: NaN, expected 0.001 to 3600"),
        (
            "practice_secs = 0.0",
            "practice_secs = 60.0",
            "briefing.practice_secs: 60, expected at least 0 and less than limit_secs, 60",
        ),
        (
            "practice_secs = 0.0",
            "practice_secs = 5.0",
            "briefing.practice_secs: 5, the rules \"targets\" have no practice",
        ),
        (
            "destination = \"own_target\"",
            "destination = \"across\"",
            "briefing.destination: \"across\", expected \"own_target\": that is what these rules count",
        ),
        ("target = [-0.05, 0.1]\n", "", "scene: \"b\" has no target, and the rules count targets"),
    ] {
        assert_eq!(refusal(changed(old, new)), format!("the task's {why}"));
    }
    let across = changed("rules = \"targets\"", "rules = \"across\"").replace("\"own_target\"", "\"across\"");
    assert!(refusal(across).starts_with("the task's order: the rules \"across\" know no order"));
}

#[test]
fn a_task_that_is_unknown_and_an_option_that_it_does_not_have_are_refused_with_what_there_is() {
    let error = TaskSpec::named("juggling", 1).expect_err("there is none").to_string();
    let known = BUILT_IN_TASKS.map(|(name, _)| name).join(", ");
    assert_eq!(
        error,
        format!("task \"juggling\" is unknown; expected {known}, or a TOML file that describes one")
    );
    let arrangement = Some(Arrangement::numbered(1).expect("1 to 24"));
    let choice = TaskSpec { arrangement, ..TaskSpec::named("bbt", 1).expect("it ships") };
    let error = choice.build(false).err().expect("it has no arrangement");
    assert!(matches!(&error, TaskError::Option { task, .. } if task == "bbt"), "{error}");
    assert!(error.to_string().contains("arrangement = FL,FM,NL,NM"), "{error}");
    // The text of a configuration names another task than the configuration.
    let choice =
        TaskSpec { name: "other".to_owned(), ..TaskSpec::from_text(SMALL.to_owned()).expect("a task") };
    let error = choice.build(false).err().expect("two names").to_string();
    assert_eq!(error, "the task's name: \"small\" in the text, \"other\" in the configuration");
}
