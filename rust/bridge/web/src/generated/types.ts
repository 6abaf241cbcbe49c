// Made from the Rust types by: UPDATE_EXPECTED=1 cargo test --release -p proact-bridge --features ts typescript
// Metres, rad, frame `world`; quaternions x, y, z, w.

/** A calibration that is in use. */
export type ActiveCalibration = {
/** `shoulder` or `headset`. */
kind: string,
/** Date, residual and verdict. */
line: string,
/** Whether a trial may rest on it. */
usable: boolean, };

/** An answer to a question of the questionnaire at `step`; none takes it back. */
export type AnswerInput = {
/** The step of the session. */
step: number,
/** Key of the item, or of the choice between two. */
key: string,
/** What was answered. */
answer: FormAnswer | null, };

/** The arm: immutable, shared by kinematics, planning, dynamics and display.
 *
 * `joints` holds every joint of the tree; vectors of joint values run over [`ArmModel::moving`], arm joints
 * first, base to tip, then hand joints in the order of the semantic group. */
export type ArmModel = {
/** Name of the robot. */
name: string,
/** Links; a parent always stands before its children, the first is the base. */
links: Array<Link>,
/** Joints, fixed ones included, sorted by child link: joint `k` moves link `k + 1`. */
joints: Array<Joint>,
/** Indices into `joints` of the arm group, base to tip. */
arm: Array<number>,
/** Indices into `joints` of the hand group in the order of the semantic group. */
hand: Array<number>,
/** Hand joints that follow others. Each has its place in the vectors of joint values, and a motor of its own that is
 * told the master's angle: what stops one of the two does not stop the other. */
mimics: Array<Mimic>,
/** Index of the link at which the arm group ends and that carries the hand. */
tip: number,
/** Named poses, such as `open` and `closed`. */
poses: Array<NamedPose>,
/** Pairs of link indices that may touch: neighbours, and pairs that overlap by construction. */
allowed_collisions: Array<[number, number]>,
/** How the hand grips from above, objects of ascending width. */
grasps: Array<Grasp>,
/** Whose arm it is. */
side: Side,
/** How it is shown and driven. */
settings: ArmSettings, };

/** How an arm is shown and driven where the method's profile does not say otherwise: the file `arm.toml` of its folder.
 *
 * Joints and links are named in full, or by what follows the last `__` of their names ([`matches_short_name`]). */
export type ArmSettings = {
/** As shown to people; empty is the robot's name. */
title: string,
/** Arm joints that method A cycles through, in this order; empty is every driven joint, base to tip. */
cycle: Array<string>,
/** Arm joints that the prosthesis has, by level of limb loss; an empty list is every arm joint. */
levels: { [key in string]: Array<string> },
/** How joints are shown, and which way they go. Joints without an entry go by their own names. */
joints: Array<JointEntry>,
/** Gains of the control `original_gains`, by joint. */
controllers: { [key in string]: JointGains },
/** Links whose forces on an object the grasp rule `original` counts. */
gripper: Array<string>,
/** Where the base stands if nobody wears the arm. */
stand: FixedBase | null, };

/** What a person is told before a trial. It is all that a simulated participant knows of the task. */
export type Briefing = {
/** As shown at the top of the page. */
title: string,
/** What is said, as plain sentences. */
text: string,
/** Which object comes next. */
order: Order,
/** Where an object goes. */
destination: Destination,
/** What the score counts, such as `blocks on target`. */
score_name: string,
/** The highest score there is; none where it is open. */
most: number | null,
/** Seconds at the start in which nothing counts. */
practice_secs: number,
/** Seconds after which the trial ends, practice included. */
limit_secs: number, };

/** What the buttons of the page ask for. */
export type CalibrationCommand = { "type": "begin" } | { "type": "proceed" } | { "type": "record_again",
/** Which. */
gesture: Gesture, } | { "type": "finish" };

/** A message to the calibration page. */
export type CalibrationMessage = { "type": "nothing" } | { "type": "error", message: string, } | CalibrationScreen;

/** What the session is doing. */
export type CalibrationPhase = { "name": "blocked",
/** What comes next. */
prompt: Prompt, } | { "name": "preparing",
/** What is asked for. */
prompt: Prompt,
/** Seconds until the recording begins. */
left_secs: number, } | { "name": "recording",
/** What is asked for. */
prompt: Prompt,
/** Share recorded, 0 to 1. */
share: number, } | { "name": "reviewing" } | { "name": "finished" };

/** How well the repetitions fit each other: each was recognised by a classifier trained on the others. */
export type CalibrationReport = {
/** Complete rounds: the fewest repetitions of any gesture. */
rounds: number,
/** Share of all windows that were recognised, 0 to 1. It is that of single windows, before the decision rule. */
accuracy: number,
/** Windows tested. */
windows: number,
/** The gesture of each row and column. */
classes: Array<Gesture>,
/** `[true class][recognised class]`, numbers of windows. */
confusion: Array<Array<number>>,
/** Share of the windows of each class that were recognised. */
recall: Array<number>,
/** By gesture, then repetition. */
repetitions: Array<RepetitionScore>,
/** Each degree of freedom of a regressor; none of a classifier. Classes are then what is driven most. */
drives?: Array<DriveScore>,
/** Accuracy without the inertial measurement unit that is used; none where none is. */
accuracy_without_imu?: number,
/** What was asked for is reached. */
good_enough: boolean, };

/** All that the calibration page shows: a page that reloads loses nothing. */
export type CalibrationScreen = {
/** Where the EMG comes from. */
source: string,
/** The last sentences to the person, oldest first. */
messages: Array<string>,
/** The button that begins was pressed. */
begun: boolean,
/** An object with the result at the end; null before. */
result: Record<string, unknown> | null, } & ({ "type": "calibration",
/** What the session is doing. */
phase: CalibrationPhase,
/** The position of the limb that is asked for; none if none is. */
position: string | null,
/** Complete rounds. */
rounds: number,
/** Rounds after which no more are offered. */
most_rounds: number,
/** The gestures of a round. */
gestures: Array<Gesture>,
/** Share of windows that has to be recognised, 0 to 1. */
target_accuracy: number,
/** R2 that each degree of freedom of a regressor has to reach, at most 1. */
target_r2: number,
/** The electrodes. */
channels: Array<ElectrodeView>,
/** The stream as a whole. */
stream: StreamQuality,
/** On the rounds so far; none before the second. */
report: CalibrationReport | null,
/** A round is over, and it waits for a command. */
reviewing: boolean, } | { "type": "ready",
/** Which. */
next: TestKind, } | { "type": "test",
/** The gesture asked for. */
prompt: Gesture | null,
/** The gesture in force. */
in_force: Gesture, } & ({ "test": "sequence", "report": SequenceReport } | { "test": "trial", "report": HoldReport }) | { "type": "motion",
/** The gesture asked for: rest before each motion. */
prompt: Gesture,
/** The hand has yet to relax. */
relaxing: boolean,
/** The gesture in force. */
in_force: Gesture,
/** Right decisions of this motion. */
right: number,
/** As many complete it. */
needed: number,
/** Time that is left for it, seconds. */
left_secs: number,
/** Of so much. */
limit_secs: number,
/** How it goes. */
report: MotionReport, } | { "type": "tac",
/** What has to go where. */
axes: Array<TacAxisState>,
/** What it waits for. */
phase: TacPhase,
/** The gesture in force. */
in_force: Gesture,
/** Share of the dwell time that is over, 0 to 1. */
dwelt: number,
/** Time that is left for the target, seconds. */
left_secs: number,
/** Of so much. */
limit_secs: number,
/** How it goes. */
report: TacReport, } | { "type": "cursor",
/** Where the cursor is. */
cursor: [number, number],
/** Centre of the target. */
target: [number, number],
/** Diameter of the target. */
width: number,
/** Share of the dwell time that is over, 0 to 1. */
dwelt: number,
/** The gesture in force. */
in_force: Gesture,
/** How hard it is made, 0 to 1. */
effort: number,
/** How it goes. */
report: CursorReport,
/** The test is over. */
finished: boolean, } | { "type": "end" });

/** The power spectrum of the newest second of a channel: Welch's estimate. */
export type ChannelSpectrum = {
/** Which, from 0. */
channel: number,
/** From line to line, hertz; the first is at zero. */
step_hz: number,
/** Power a hertz, the device's unit squared; without the mean, up to 1 kHz. */
density: Array<number>, };

/** A traffic light. */
export type ChannelStatus = "green" | "amber" | "red";

/** A message of the page on the WebSocket. */
export type ClientMessage = { "type": "gesture", gesture: Command, } | { "type": "gaze", origin: [number, number, number], direction: [number, number, number], measured?: boolean, } | { "type": "trunk", forward: number, lateral: number, axial: number, } | { "type": "head", position: [number, number, number],
/** x, y, z, w. */
quaternion: [number, number, number, number], } | { "type": "controller" } & ControllerPose | { "type": "restart", method?: string, again?: boolean, } | { "type": "study", action: StudyAction, } | { "type": "gaze_check" } & GazeCheck | { "type": "join", name: string, } | { "type": "take_over", } | { "type": "drawn", } | { "type": "hold", on: boolean, } | { "type": "watch", signals: boolean, } | { "type": "after", ask: PostTrialAction, } | { "type": "conduct" } & StudyRequest | { "type": "answer" } & AnswerInput | { "type": "submit", step: number, } | { "type": "alive", } | { "type": "seen", frames: Array<DisplayedFrame>, } | { "type": "ping", id: number, };

/** A collision shape of a link. */
export type CollisionShape = {
/** `link_from_shape`. */
pose: Pose,
/** The shape. */
shape: Shape, };

/** What a control method can be told by hand: its commands, named after the gestures that give them in the paper.
 *
 * The gestures that an EMG model tells apart are its own ([`crate::Gesture`]);
 * [`crate::CommandMap`] makes commands of them. */
export type Command = "hand_close" | "hand_open" | "no_motion" | "wrist_extension" | "wrist_flexion";

/** A link that touches blocks, as shown. */
export type ContactView = {
/** Its name. */
link: string,
/** The sum of its normal forces on them, N. */
force: number, };

/** What the movement gestures move. */
export type ControlledDof = { "joint": number } | { "translation": number } | { "rotation": number };

/** Where a headset's controller is in `world`, as the headset's browser tells it. */
export type ControllerPose = {
/** In which hand, or on which arm. */
hand: Side,
/** On the page's clock, ms. */
time_ms: number,
/** m. */
position: [number, number, number],
/** x, y, z, w. */
quaternion: [number, number, number, number],
/** Seen by the headset now; otherwise its place is a guess. */
tracked: boolean, };

/** The occasions for a cue. */
export type Cue = "contact_made" | "contact_lost" | "on_target" | "off_target" | "pressure" | "grip";

/** The step that is to be done, or is being done. */
export type CurrentStepScreen = {
/** Which. */
step: number,
/** In a few words. */
label: string,
/** It was begun, and goes on. */
running: boolean,
/** Since it was begun, seconds. */
since_secs: number,
/** What it is. */
what: StepActivity, };

/** One movement to a target. */
export type CursorMovement = {
/** The cursor stayed in the target for the dwell time. */
completed: boolean,
/** Distance from the start to the target's centre. */
distance: number,
/** Diameter of the target. */
width: number,
/** Index of difficulty, `log2(distance / width + 1)`, bits. */
difficulty_bits: number,
/** From the moment the target is shown to the last time that the cursor entered it: reaction included, dwell not.
 * The whole time if it was not completed. */
movement_secs: number,
/** Straight line over the way taken, to where the cursor came to rest, 0 to 1; 0 if it was not completed. */
path_efficiency: number,
/** Times that the cursor left the target before the dwell was over. */
overshoots: number, };

/** How the cursor test went. */
export type CursorReport = {
/** Movements that are over. */
movements: Array<CursorMovement>,
/** Share of them that were completed. */
completion_rate: number,
/** Mean of difficulty over movement time, completed movements, dwell not counted, bits per second. */
throughput_bits_per_s: number,
/** The same with the dwell counted into the time, as some programs report it. */
throughput_with_dwell_bits_per_s: number,
/** Mean over completed movements. */
path_efficiency: number,
/** Mean over all movements. */
overshoots: number,
/** Movements asked for. */
asked: number, };

/** A degree of freedom that muscles drive both ways, named by the gestures that do: `wrist_extension/wrist_flexion`.
 *
 * Regression and proportional, simultaneous control know degrees of freedom in the place of classes (LibEMG, `EMGRegressor`). */
export type DegreeOfFreedom = string;

/** Where a person is asked to put an object. */
export type Destination = "own_target" | "across" | "shown";

/** What departs from the plan. */
export type Deviation = "repeated" | "left_out" | "split_over_days" | "other_day" | "other_order" | "retrained" | "recalibrated" | "not_ready" | "plan_changed" | "clock_set";

/** A digit of the hand. */
export type Digit = {
/** Its place among the hand's digits, from 0, in the order of the description. */
number: number,
/** Its first link. */
link: string, };

/** One consistent instant, as drawn: the page, the headset and the simulated participant all see this and
 * nothing else. */
export type DisplayFrame = {
/** The instant. */
time: SimTime,
/** Name of the control method, such as `D`. */
method: string,
/** Moving joints of the arm model, in its order, rad. */
joints: Array<number>,
/** `world_from_base`. */
world_from_base: Pose,
/** `world_from_tip`. */
world_from_tip: Pose,
/** `world_from_head`: x ahead, y left, z up; the eye is its origin. */
world_from_head: Pose,
/** `world_from_object` of all objects of the scene. */
objects: Array<Pose>,
/** The hand. */
hand: HandView,
/** Gaze as measured. */
gaze: GazeSample | null,
/** Selection marker. */
target: TargetView,
/** The planner and the motion. */
planner: PlannerView,
/** Arm joints at the end of the plan that is followed, rad; none while no plan is followed. */
goal: Array<number> | null,
/** What the next movement gesture moves, for methods that cycle through joints or axes. */
mode: ModeView | null,
/** Why the arm must stand still; none while it need not. */
stop: Stop | null,
/** Command in force, from the gesture that was recognised. */
gesture: Command,
/** The gesture in force by its own name, as the EMG model calls it; that of the command for keys. */
recognised: Gesture,
/** Probability of the recognised class, 0 to 1; one for keys. */
confidence: number,
/** How hard the recognised gesture is made, 0 to 1; one for keys. */
effort: number,
/** Where the EMG comes from: `recording`, `synthetic`, `keys`. */
emg_source: string,
/** Seconds until the time limit. */
time_left_secs: number,
/** The object that the task asks for next. */
next: ObjectId | null,
/** Where that goes, or what the hand or the joints are asked for; none where the task asks for one thing all the time. */
asked?: TaskGoal | null,
/** What the task counts, so far. */
score: number,
/** True when the trial is over. */
finished: boolean,
/** Events since the frame before: the log. */
events: Array<TrialEvent>,
/** Links that touch blocks. */
contacts: Array<ContactView>,
/** What was to be heard and felt since the frame before. */
feedback: Array<FeedbackCue>, };

/** A frame that was on a picture, as the page tells it. Times are on the server's clock, as `pong` gave it to the page. */
export type DisplayedFrame = {
/** Which frame: its instant. */
time: SimTime,
/** It had come to the page, ms. */
came_ms: number,
/** The first picture that was no older than it had been handed to the screen, ms. */
shown_ms: number, };

/** How well a regressor drives one degree of freedom in repetitions that it was not trained on. The target of a window is 1
 * or -1 by its gesture, else 0; the drive is taken before the dead band. */
export type DriveScore = {
/** The degree of freedom. */
drive: DegreeOfFreedom,
/** Coefficient of determination over all windows, at most 1: 0 is what the mean of the targets would reach. */
r2: number,
/** Mean absolute error. */
mean_absolute_error: number, };

/** What is shown of an electrode. */
export type ElectrodeView = {
/** The verdict. */
light: ChannelStatus,
/** What is wrong, for the person; none if nothing is. */
fault: string | null, };

/** What whoever conducts a study sees. */
export type ExperimenterScreen = {
/** Its name. */
study: string,
/** For people. */
title: string,
/** Trials that are over, and all of the plan. */
trials: [number, number],
/** Who takes part. */
participants: Array<ParticipantRow>,
/** Whose turn it is; none while a session is under way, and when all are over. */
next: NextSession | null,
/** The session under way. */
session: SessionScreen | null,
/** What may be asked for now. */
can: Array<StudyButton>,
/** What came of the last request, or what was found; empty if there is nothing to say. */
notice: string,
/** Notes of the session, oldest first. */
notes: Array<string>, };

/** What a person is to hear and feel, as data: who drives a loudspeaker or a vibrating band decides how. */
export type FeedbackCue = {
/** When. */
time: SimTime,
/** Why. */
cue: Cue,
/** The digit that it is about; none if it is about none alone. */
digit?: Digit,
/** What is to be heard. */
sound: Tone | null,
/** What is to be felt. */
vibration: Vibration | null, };

/** An arm that stands on something and does not move with a person's trunk. */
export type FixedBase = {
/** Where the base's origin is, `world`, metres. Its axes are those of `world`. */
xyz: [number, number, number], };

/** A questionnaire: a file of data. */
export type Form = {
/** By which a plan names it. */
name: string,
/** For people. */
title: { [key in string]: string },
/** Where the items come from. */
source: string,
/** Under which they may be used. */
licence: string,
/** The wording is that of the source, item by item. */
confirmed: boolean,
/** How it is scored. */
scoring: Scoring,
/** What is asked, in this order. */
items: Array<FormItem>, };

/** What was answered. */
export type FormAnswer = number | string | Array<string> | Array<Array<string>>;

/** Something that is asked. */
export type FormItem = { "kind": "scale",
/** In the tables. */
key: string,
/** Its short name; the text if left out. */
name: { [key in string]: string },
/** The question. */
text: { [key in string]: string },
/** What the lowest number means. */
low: { [key in string]: string },
/** What the highest number means. */
high: { [key in string]: string },
/** The lowest number. */
least: number,
/** The highest number. */
most: number,
/** From one number to the next. */
step: number, } | { "kind": "choice",
/** In the tables. */
key: string,
/** The question. */
text: { [key in string]: string },
/** What can be answered. */
options: Array<FormOption>,
/** More than one may be chosen. */
several: boolean, } | { "kind": "ranking",
/** In the tables. */
key: string,
/** The question. */
text: { [key in string]: string }, } | { "kind": "condition",
/** In the tables. */
key: string,
/** The question. */
text: { [key in string]: string }, } | { "kind": "consent",
/** In the tables. */
key: string,
/** Which text is agreed to; the answer, and with it the tables, say it. */
version: string,
/** What is agreed to. */
text: { [key in string]: string }, } | { "kind": "text",
/** In the tables. */
key: string,
/** The question. */
text: { [key in string]: string },
/** It may be left empty. */
optional: boolean, };

/** An answer that can be chosen. */
export type FormOption = {
/** In the tables. */
value: string,
/** For people. */
text: { [key in string]: string }, };

/** A choice between two items of a questionnaire. */
export type FormPair = {
/** Of the choice. */
key: string,
/** Key of an item. */
first: string,
/** Key of the other one. */
second: string, };

/** A questionnaire that is being answered. */
export type FormScreen = {
/** Which step of the session it is: answers name it. */
step: number,
/** What it asks. */
form: Form,
/** Pairs of items between which is chosen, with the key of the choice. */
pairs: Array<FormPair>,
/** The conditions that it may ask about, as people know them. */
conditions: Array<string>,
/** What it is about; none if about the whole session. */
about: string | null,
/** Answers that are kept, by key. */
answers: { [key in string]: FormAnswer },
/** Keys that have no answer yet and should have one. */
missing: Array<string>,
/** The last answer that was refused, and why. */
refused: RefusedAnswer | null, };

/** How well a gaze source follows known points, as the page measured it. */
export type GazeCheck = {
/** What looked: `mouse`, `head`, `hand`, or the name of a tracker. */
source: string,
/** One entry a point, in the order shown. */
points: Array<GazePoint>,
/** What is to be taken off the gaze from now on, degrees to the left and upwards; none if it stays as it is. */
correction_deg: [number, number] | null, };

/** What was measured while one point was looked at. */
export type GazePoint = {
/** Mean angle between gaze and point, degrees; none if no sample was valid. */
accuracy_deg: number | null,
/** Root mean square angle from one valid sample to the next, degrees; none with fewer than two. */
precision_deg: number | null,
/** Mean of gaze minus point, degrees to the left and upwards; none if no sample was valid. */
offset_deg: [number, number] | null,
/** Samples that were missing or invalid, 0 to 1. */
lost_share: number,
/** Gaps of 70 to 500 ms. */
blinks: number,
/** Samples that came. */
samples: number, };

/** One gaze measurement. */
export type GazeSample = {
/** The eye, in `world`. */
origin: [number, number, number],
/** Where it looks, in `world`; any length above zero. */
direction: [number, number, number],
/** False while the tracker has lost the eye or the person blinks. */
valid: boolean, };

/** The name of a gesture that an EMG model tells apart: any text, unlike [`Command`], which is what a method takes.
 *
 * Not empty, at most [`Gesture::MAX_BYTES`] bytes, no control characters, no space at either end. Lives on the
 * stack, so that the EMG stage can hand it on without an allocation. */
export type Gesture = string;

/** A second arm that is seen through and moves nothing. */
export type GhostArm = {
/** Moving joints of the arm model, in its order, rad. */
joints: Array<number>,
/** Red, green and blue, 0 to 1. */
colour: [number, number, number],
/** From 0, not to be seen, to 1, solid. */
alpha: number, };

/** How the hand grips what stands upright and is so wide, from above: with the grasp's centre in the middle of the object,
 * rolled about x of the tip's frame and leaning about y. Hand, planner and simulated participants go by it. */
export type Grasp = {
/** Widths of the objects that it holds, metres: the smallest and the largest. */
widths: [number, number],
/** Where the centre of a grasped object lies, in the tip's frame, metres. */
centre: [number, number, number],
/** Pose of the hand before it closes: room for the object, and no wider than its neighbours allow. */
open_pose: string,
/** Pose of the hand that it closes to; the object stops it on the way. */
closed_pose: string,
/** Where the digits close in one direction: this direction in the tip's frame, of any length. A box is then gripped
 * by two of its faces where the arm can. */
closing: [number, number, number] | null,
/** Roll at which the fingers close best, rad: at zero z of the tip's frame is up. */
roll: number,
/** Smallest and largest roll at which they close, rad. */
roll_range: [number, number],
/** Largest lean, both ways, rad. */
lean: number,
/** An object whose centre is this near to the grasp's is between the fingers, metres. */
opening: number,
/** Where the open hand may come off an object other than straight up: a direction in the tip's frame, of any length. */
withdrawal: [number, number, number], };

/** Why a hand that closed holds nothing. */
export type GraspFault = "no_grasp" | "nothing" | "not_touched" | "one_digit" | "not_opposing" | "slipped";

/** The hand's state, from its joints. */
export type HandState = "open" | "closing" | "closed" | "opening";

/** What is seen of the hand. */
export type HandView = {
/** Open, closed, or between. */
state: HandState,
/** The object in it. */
holds: ObjectId | null, };

/** How the longer trial went. */
export type HoldReport = {
/** The share is reached. False until all prompts are over. */
passed: boolean,
/** Share of decisions after the reaction time with the prompted gesture in force. */
accuracy: number,
/** Decisions counted. */
decisions: number,
/** Prompts that are over. */
prompts: number,
/** The gesture of each row and column. */
classes: Array<Gesture>,
/** `[prompted][in force]`, decisions. */
confusion: Array<Array<number>>, };

/** Mass properties of a link. */
export type Inertial = {
/** kg, above zero. */
mass: number,
/** `link_from_inertial`: the origin is the centre of mass. */
pose: Pose,
/** ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, in the inertial frame's axes, kg m^2. */
inertia: [number, number, number, number, number, number], };

/** The newest value of a channel of an inertial measurement unit. */
export type InertialValue = {
/** Such as `acceleration_x`. */
name: string,
/** Such as `g`. */
unit: string,
/** None before the first, and for what is no number. */
value: number | null, };

/** What gives gestures or measurements to a trial, and may die while the arm moves. */
export type InputSource = "armband" | "gesture_topic" | "page" | "eye_tracker" | "shoulder_tracker" | "limb_tracker" | "stage" | "participant" | "method";

/** What an [`IntentEstimate`] is spread over. */
export type IntentDomain = "objects" | "places";

/** What gaze and task say of what is meant, each for itself and both together. Lists have the order of the scene and sum to
 * one, rounded. */
export type IntentEstimate = {
/** Of what. */
over: IntentDomain,
/** By the gaze alone, without task context: what method C goes by. */
likelihood: Array<number>,
/** By the task alone. */
prior: Array<number>,
/** By both: what method D goes by. */
posterior: Array<number>, };

/** A joint. */
export type Joint = {
/** Unique name. */
name: string,
/** How it moves. */
kind: JointKind,
/** Index of the parent link. */
parent: number,
/** Index of the child link. */
child: number,
/** `parent_from_child` at position zero. */
origin: Pose,
/** Unit axis in the joint frame. */
axis: [number, number, number],
/** Limits; zero for a fixed joint. */
limits: JointLimits,
/** Viscous damping, N m s/rad or N s/m. */
damping: number,
/** Coulomb friction, N m or N. */
friction: number, };

/** How a joint is shown. */
export type JointEntry = {
/** The joint's name in the model, or what follows its last `__`. */
joint: string,
/** As shown. */
name: string,
/** What WE does, as shown. */
we: string,
/** What WF does, as shown. */
wf: string,
/** Sign of the joint's motion for WE: 1 or -1. */
we_sign: number, };

/** Gains of a joint's position controller without feed-forward. */
export type JointGains = {
/** Proportional, N m/rad. */
p: number,
/** Derivative, N m s/rad. */
d: number, };

/** Where a joint is asked to be. */
export type JointGoal = {
/** Its place in the arm, from 0 at the base. */
joint: number,
/** rad. */
angle: number,
/** It may be off by this much, rad. */
tolerance: number, };

/** Kinds of joint that an arm may have. */
export type JointKind = "fixed" | "revolute" | "continuous" | "prismatic";

/** Limits of a joint. */
export type JointLimits = {
/** Smallest position, rad or m. */
lower: number,
/** Largest position, rad or m. */
upper: number,
/** Highest speed, rad/s or m/s. */
velocity: number,
/** Highest effort, N m or N. */
effort: number, };

/** How long one stage took so far in the trial. */
export type LatencyRow = {
/** Which. */
stage: LatencyStage,
/** How often it was measured. */
count: number,
/** Milliseconds. */
median_ms: number,
/** What 99 of 100 keep, milliseconds. */
p99_ms: number,
/** Milliseconds. */
worst_ms: number, };

/** A part of the way from a muscle to the light of a screen. */
export type LatencyStage = "recognition" | "queue" | "emg" | "intent" | "method" | "actuation" | "target" | "world" | "task" | "tick" | "motion" | "frame" | "line" | "picture" | "whole";

/** A rigid link. */
export type Link = {
/** Unique name. */
name: string,
/** None for frames without mass. */
inertial: Inertial | null,
/** Shapes that collide. */
collisions: Array<CollisionShape>,
/** Shapes that are drawn. */
visuals: Array<Visual>, };

/** A mesh of an arm, served as `/meshes/<id>`. A description without meshes is drawn from its primitive shapes. */
export type MeshFile = {
/** As the description gives it. */
address: string,
/** Hash of the content: two arms may have other meshes at one address. */
id: string, };

/** What the page says of a method. Empty texts leave the page's own. */
export type MethodHelp = {
/** One sentence. */
summary: string,
/** What HC does, in a word or two. */
hand_close: string,
/** What HO does. */
hand_open: string,
/** What WE does. */
wrist_extension: string,
/** What WF does. */
wrist_flexion: string, };

/** What is told of a control method to those who choose it, show it, or act in the place of a person. */
export type MethodInfo = {
/** By which it is chosen, and called in results and records, such as `D`: letters, digits, `_` and `-`. */
name: string,
/** As shown, such as `gaze and context`. */
title: string,
/** What it cannot do without. */
needs: MethodNeeds,
/** How a person drives it. */
style: MethodStyle,
/** What the page says of it. */
help: MethodHelp, };

/** What a method cannot do without. */
export type MethodNeeds = {
/** Gaze: a trial without a source of it is refused, and the arm stops when the eye tracker dies. */
gaze: boolean,
/** The task's context has a say in the posterior. */
prior: boolean,
/** It asks for plans. There is no speed to blend then. */
plans: boolean,
/** It drives every joint of the arm: a profile whose level leaves joints to the person's limb is refused. */
whole_arm: boolean,
/** The tracked limb of the person: a profile whose level leaves no joint to the limb is refused. */
limb: boolean, };

/** How a person drives a method. The page's hints and the simulated participant go by it. */
export type MethodStyle = "jogging" | "selecting" | "imitating";

/** A joint that another one takes along. */
export type Mimic = {
/** Index into `joints` of the joint that follows. */
joint: number,
/** Index into `joints` of the joint that it follows. */
master: number,
/** The follower's angle per angle of the master. */
multiplier: number,
/** The follower's angle where the master's is zero, rad. */
offset: number, };

/** The joint or axis that WE and WF move, in methods A and B. */
export type ModeView = {
/** What is moved. */
moves: ControlledDof,
/** As shown, such as `elbow flexion`. */
name: string,
/** What WE does, such as `flexion`, and what WF does. */
directions: [string, string],
/** 1 if WE turns the joint or moves the axis in its positive direction, -1 if in the other. */
we_sign: number,
/** Seconds until a held HO moves on; none when it is not held. */
next_in_secs: number | null, };

/** One motion that was asked for. */
export type MotionAttempt = {
/** Which. */
prompt: Gesture,
/** From the first decision that is not rest to the first right one, seconds; none if there was none. */
selection_secs: number | null,
/** From there to the last right decision that was needed, seconds; none if time ran out before. */
completion_secs: number | null,
/** Right decisions. */
right: number,
/** Decisions that were neither rest nor right. */
wrong: number, };

/** How the motion test went. */
export type MotionReport = {
/** All motions up to now. */
attempts: Array<MotionAttempt>,
/** Motions asked for in the whole test. */
asked: number,
/** Share of the motions up to now that were completed. */
completion_rate: number,
/** Mean over the motions that were selected, seconds; none before one was. */
mean_selection_secs: number | null,
/** Mean over the motions that were completed, seconds; none before one was. */
mean_completion_secs: number | null, };

/** Joint angles with a name. */
export type NamedPose = {
/** Such as `open`. */
name: string,
/** Group it belongs to: `arm` or `hand`. */
group: string,
/** One position per joint of the group, rad, of prismatic joints m. */
angles: Array<number>, };

/** Whose turn it is. */
export type NextSession = {
/** Place in the plan. */
participant: number,
/** Pseudonym, if somebody has the place. */
id: string | null,
/** Name of the session. */
session: string,
/** It was begun before. */
begun: boolean,
/** What departs from the plan if it goes on today; empty if nothing does. */
departs: string, };

/** A movable object of the scene, by its place in [`Scene::objects`]. All arrays over objects have that order. */
export type ObjectId = number;

/** What became of one object, as a line of a [`ResultCard`]. */
export type ObjectResultRow = {
/** Its name. */
name: string,
/** What became of it, such as `on_target`. */
outcome: string,
/** Seconds from the release of the one before, or the start, to the first contact; none if it was never held. */
pick_s: number | null,
/** Seconds from the last contact to the release; none if it was never released. */
place_s: number | null,
/** Horizontal distance from its target at the end, metres. */
error_m: number | null, };

/** Which object a person is asked for. */
export type Order = "prescribed" | "any";

/** What does not change during a trial. */
export type PageContent = {
/** Shown at the top, such as `demo` or a participant's number. */
title: string,
/** Name of the set-up, such as `seated`. */
setup: string,
/** The arm. */
arm: ArmModel,
/** Its meshes, as far as they are there; a link whose mesh is not is drawn by its collision shapes. */
meshes: Array<MeshFile>,
/** The room. */
scene: Scene,
/** What the person is told of the task. */
briefing: Briefing,
/** The page drives: mouse is gaze, keys are gestures. Otherwise it only shows, and inputs are refused. */
interactive: boolean,
/** The trunk moves: lean keys are offered. */
lean: boolean,
/** The control method of the trial. */
method: MethodInfo,
/** The methods by which another trial may begin. */
methods: Array<MethodInfo>, };

/** A place in the plan. */
export type ParticipantRow = {
/** From 1. */
participant: number,
/** Pseudonym; none for a place that nobody has. */
id: string | null,
/** Steps that are over, and all, over all sessions. */
steps: [number, number],
/** Trials that are over, and all. */
trials: [number, number], };

/** What a participant sees of a study: what is to be done now, and nothing else. */
export type ParticipantScreen = { "show": "wait" } | { "show": "listen" } | { "show": "form" } & FormScreen | { "show": "rest",
/** Until its planned end, seconds; zero from then on. */
left_secs: number, } | { "show": "train" } & PromptScreen | { "show": "scene",
/** The time that is left is shown. */
countdown: boolean,
/** Above the scene; empty in a trial. */
title: string, } | { "show": "thanks" };

/** The part of the table top on which an object may be put down, along the axes of `world`. */
export type PlaceRegion = {
/** Smallest x and y, metres. */
min: [number, number],
/** Largest x and y, metres. */
max: [number, number], };

/** How a plan ended. */
export type PlanStatus = "ok" | "intermediate" | "no_plan" | "unreachable" | "start_in_collision" | "goal_in_collision" | "invalid" | "cancelled";

/** Planner status as shown. */
export type PlannerView = { "state": "idle" } | { "state": "planning" } | { "state": "executing",
/** From 0 to 1. */
progress: number,
/** The plan ends at a point on the way. */
intermediate: boolean, } | { "state": "arrived",
/** The plan ended at a point on the way. */
intermediate: boolean, } | { "state": "failed",
/** Why. */
status: PlanStatus,
/** One sentence. */
reason: string, };

/** A rigid transform, metres. */
export type Pose = {
/** Unit quaternion x, y, z, w. */
rotation: [number, number, number, number],
/** Along x, y, z. */
translation: [number, number, number], };

/** How steady a stream of poses was in the last ten seconds. */
export type PoseStreamStatistics = {
/** How much later than the quickest pose half of them arrive, s. */
lag_secs: number,
/** The same for one in a hundred, less the lag, s. */
jitter_secs: number,
/** Gaps: poses that the system left out. */
dropouts: number,
/** The longest gap, s. */
longest_secs: number,
/** Share of the time that was missing, 0 to 1. */
missing: number, };

/** What a person asks for after a trial that was shown. */
export type PostTrialAction = "watch_again" | "drive";

/** What the person is asked for. */
export type Prompt = {
/** The gesture. */
gesture: Gesture,
/** Which repetition of it, from 0. */
repetition: number, };

/** A prompt to make a gesture. */
export type PromptScreen = {
/** What to make now. */
gesture: Gesture,
/** What to do, in a few words. */
text: string,
/** Share of the gesture or of the test that is over, 0 to 1. */
share: number,
/** Muscles are being recorded. */
recording: boolean,
/** What is recognised now; none while nothing is. */
recognised: Gesture | null,
/** Sequences in a row without a mistake. */
in_a_row: number,
/** How many of them pass; none if the experimenter judges. */
wanted: number | null,
/** It is passed. */
passed: boolean,
/** The page's own keys make the gestures, and no armband does. */
keys: boolean, };

/** What of the box is in reach for this person and table. */
export type ReachGrid = {
/** In one sentence. */
line: string,
/** Height of the places, m, `world`. */
height_m: number,
/** From place to place, m. */
spacing_m: number,
/** The places. */
spots: Array<ReachPoint>, };

/** One place of the box in a picture of what is in reach. */
export type ReachPoint = {
/** m, `world`: ahead. */
x: number,
/** m, `world`: to the left. */
y: number,
/** The smallest lean forward of those tried from which the hand gets there, degrees; none if it does not. */
lean_deg: number | null, };

/** Whether something is ready. */
export type ReadinessCheck = {
/** Such as `gestures`. */
name: string,
/** It is. */
ready: boolean,
/** What was found, for the experimenter. */
found: string,
/** How old that is, seconds; none where age does not matter. */
age_secs?: number | null, };

/** What the EMG model makes of the stream. */
export type Recognition = {
/** The gestures that the model tells apart. */
gestures: Array<Gesture>,
/** Probability of each in the newest window, in the order of `gestures`; empty before the first window, zeros while the
 * stream is dead. */
posterior: Array<number>,
/** The gesture in force, by the decision rule. */
in_force: Gesture,
/** What the newest window gave to the decision rule; none if it was rejected, or there is none. */
window_class: Gesture | null,
/** How hard it is made, 0 to 1. */
effort: number,
/** Gestures act: no relaxed hand is waited for. */
armed: boolean,
/** Why the stream is dead, as a sentence; none while it lives. */
fault: string | null, };

/** EMG of a recorded trial, thinned for a picture, and what the EMG model made of it. */
export type RecordedEmg = {
/** Nominal sampling rate, hertz. */
rate_hz: number,
/** Length of a step of `lowest` and `highest`, milliseconds; the first begins at zero. */
step_ms: number,
/** Lowest value of each channel in each step, `[n_steps][n_channels]`, in the device's unit; a step without samples is empty. */
lowest: Array<Array<number>>,
/** The highest ones. */
highest: Array<Array<number>>,
/** The gestures that the model tells apart. */
gestures: Array<Gesture>,
/** What it made of each window, times ascending. */
windows: Array<RecordedWindow>, };

/** A recorded trial with everything that its replay shows. */
export type RecordedTrial = {
/** Name of its directory. */
name: string,
/** Control method. */
method: string,
/** Set-up. */
setup: string,
/** Seed, as text: JavaScript has no whole numbers above 2^53. A bag has none. */
seed: string | null,
/** Length, simulated seconds. */
seconds: number,
/** What the task counted in the end. */
score: number,
/** Arm and scene. */
content: PageContent,
/** The recomputed trial has the recorded digest; none for a bag, which is not recomputed. */
agrees: boolean | null,
/** The record has a result; a trial that crashed has none. */
finished: boolean,
/** What was displayed, times ascending. */
frames: Array<DisplayFrame>,
/** The muscles; none without an armband, and for a bag. */
emg: RecordedEmg | null, };

/** What the EMG model made of a window. */
export type RecordedWindow = {
/** When the window ended. */
time: SimTime,
/** Probability of each gesture, in the order of [`RecordedEmg::gestures`]; zeros while the stream is dead. */
posterior: Array<number>,
/** The gesture in force then, by the decision rule. */
in_force: Gesture,
/** How hard it is made, 0 to 1. */
effort: number, };

/** An answer that cannot be. */
export type RefusedAnswer = {
/** Of what. */
key: string,
/** Why. */
reason: string, };

/** What is known of one repetition. */
export type RepetitionScore = {
/** What the person was asked for. */
gesture: Gesture,
/** Number of the repetition of this gesture, from 0. */
repetition: number,
/** Windows in it. */
windows: number,
/** Share of its windows that a classifier trained on the other repetitions recognises. */
recognised: number,
/** How far its mean lies from that of the other repetitions of the gesture, in standard deviations within the
 * gestures, root mean square over features. */
distance: number,
/** It differs so much from the others that it should be looked at, and better be recorded again. With two
 * repetitions both are marked: nothing tells which of them is the odd one. */
outlier: boolean, };

/** How a trial went, for whoever drove or watched. */
export type ResultCard = {
/** Who drove, such as `You`. */
who: string,
/** Name of the method. */
method: string,
/** What the task counts. */
score: number,
/** The most that it can be; none if there is no bound. */
most: number | null,
/** What the score is, such as `blocks on target`. */
score_name: string,
/** Length of the trial, simulated seconds. */
seconds: number,
/** Length of the wrist's path, metres. */
path_m: number,
/** How often the hand closed to take something. */
attempts: number,
/** What became of each object, for tasks that tell. */
objects: Array<ObjectResultRow>,
/** What people with two sound hands reach, a line each, where that is known. */
norms: Array<string>,
/** What is wrong with the trial, a sentence each. */
faults: Array<string>, };

/** What a connection may see and do. */
export type Role = "participant" | "experimenter" | "spectator";

/** Everything in the room except the arm. */
export type Scene = {
/** Table, walls, partition, legs, floor. */
fixed: Array<SceneObject>,
/** What can be moved. */
objects: Array<SceneThing>,
/** Where objects belong; some may have no such place. */
targets: Array<Target>,
/** Where objects may be put down. */
put_down: PlaceRegion,
/** Height of the table top, metres in `world`. */
table_height: number, };

/** An immovable body of the scene, such as a wall of the box. */
export type SceneObject = {
/** Unique name. */
name: string,
/** Its shape. */
shape: Shape,
/** `world_from_object`. */
pose: Pose,
/** Coulomb friction coefficient against blocks. */
friction: number, };

/** A movable object. */
export type SceneThing = {
/** Unique name in results and plans, such as `red1`. */
name: string,
/** What is painted on it; empty for nothing. */
label: string,
/** Red, green, blue, 0 to 1 (sRGB). */
colour: [number, number, number],
/** Name of its model and tf frame on a ROS graph. */
ros_name: string,
/** Its shape; the origin is the centre of mass. */
shape: Shape,
/** Mass, kg, spread evenly. */
mass: number,
/** Friction against table, walls and other objects. */
friction: number,
/** Friction against fingers. */
friction_finger: number,
/** It may be pushed about and dropped, as the cubes of a heap: a plan that finds no grip without a contact may touch it on
 * the straight way into one and out, and one that cannot put it down may let it fall. */
loose?: boolean,
/** `world_from_object` at the start: resting. */
pose: Pose, };

/** How a questionnaire is scored. */
export type Scoring = { "by": "nothing" } | { "by": "task_load",
/** Every pair of items is asked for: which of them contributed more. */
pairs: boolean, } | { "by": "usability", };

/** A mistake in a sequence. */
export type SequenceMistake = {
/** Sequence in which it was made, from 0. */
attempt: number,
/** What was asked for. */
prompt: Gesture,
/** What came into force instead; none if the time ran out. */
got: Gesture | null, };

/** How the sequence test went. */
export type SequenceReport = {
/** As many sequences as asked for went without a mistake, one after the other. */
passed: boolean,
/** Sequences begun. */
attempts: number,
/** Sequences without a mistake up to now, in a row. */
in_a_row: number,
/** All mistakes. */
mistakes: Array<SequenceMistake>,
/** Seconds from each prompt to its gesture, mean over those that came. */
mean_delay_secs: number, };

/** Messages from the server to the page. */
export type ServerMessage = { "type": "hello", page_version: string, revision: number,
/** The controller that is strapped to the brace: it is neither gaze nor buttons. */
brace_controller: Side | null, } | { "type": "content", revision: number, } | { "type": "frame" } & DisplayFrame | { "type": "status" } & TrialStatus | { "type": "driver", name: string | null, you: boolean, may_drive: boolean, } | { "type": "ghost", arm: GhostArm | null, } | { "type": "signals" } & Signals | { "type": "study" } & ExperimenterScreen | { "type": "participant" } & ParticipantScreen | { "type": "delay", ms: number | null, } | { "type": "pong", id: number, clock_ms: number, } | { "type": "events", events: Array<TrialEvent>, } | { "type": "error", message: string, };

/** A session under way. */
export type SessionScreen = {
/** Place in the plan. */
participant: number,
/** Pseudonym. */
id: string,
/** Its name. */
session: string,
/** What happens in it. */
steps: Array<StepRow>,
/** What happens now; none if all of it is over. */
now: CurrentStepScreen | null,
/** What is left of it takes at most so long by the plan, minutes. */
minutes_left: number, };

/** A convex shape, metres, centred in its own frame; axes along z. */
export type Shape = { "type": "box",
/** Along x, y, z. */
size: [number, number, number], } | { "type": "sphere",
/** Radius. */
radius: number, } | { "type": "cylinder",
/** Radius. */
radius: number,
/** Full length along z, flat ends. */
length: number, } | { "type": "capsule",
/** Radius of the tube and of the round ends. */
radius: number,
/** Length of the tube without the round ends. */
length: number, };

/** The wearer's side that an arm belongs to. Where a left arm differs from a right one, the world is mirrored across the
 * wearer's sagittal plane, x and z of `world`. */
export type Side = "right" | "left";

/** What the experimenter watches beside the scene: about ten times a second, the latest only. */
export type Signals = {
/** The instant of the last sample. */
time: SimTime,
/** EMG since the message before, `[n_rows][n_channels]`, in the device's unit; empty without an armband. Rows are samples,
 * or, of streams too dense to draw, in turn the lowest and the highest values of a block of samples. */
emg: Array<Array<number>>,
/** Rows of `emg` a second, hertz; zero without an armband. */
emg_row_hz: number,
/** Spectra of some channels, in turn, of streams whose samples are not sent; each channel's stays until the next. */
spectra: Array<ChannelSpectrum>,
/** Nominal sampling rate, hertz; zero without an armband. */
emg_rate_hz: number,
/** Newest values of an inertial measurement unit; empty without one. */
inertial: Array<InertialValue>,
/** One light a channel: `green`, `amber`, `red`. */
lights: Array<string>,
/** What is wrong with a channel, for each, such as `flat` or `mains`; none if nothing is. */
faults: Array<string | null>,
/** Share of samples that were lost, 0 to 1. */
emg_lost_share: number,
/** What the muscles say; none without an armband. */
recognition: Recognition | null,
/** What gaze and task say; none for methods that do not go by the gaze, and while there is nothing to mean. */
intent: IntentEstimate | null,
/** Milliseconds since the last valid gaze; none if there was none yet. */
gaze_age_ms: number | null,
/** Gaze samples a second. */
gaze_hz: number,
/** Tracked shoulder poses a second. */
tracking_hz: number,
/** Mean computing time of a tick of 1 ms, microseconds. */
tick_mean_us: number,
/** Longest one since the message before, microseconds. */
tick_max_us: number,
/** Simulated over real time since the message before; 1 is in step. */
pace: number,
/** What the way from muscle to light takes, stage by stage; what was not measured yet is not there. */
latency: Array<LatencyRow>,
/** Pages connected. */
pages: number, };

/** Simulated time since the start of the trial, in whole ticks of 1 ms. */
export type SimTime = number;

/** What happens in a session now. */
export type StepActivity = { "is": "say",
/** The words. */
text: string, } | { "is": "form" } & FormScreen | { "is": "train" } & PromptScreen | { "is": "calibrate_gaze",
/** Mean error of the newest check, degrees; none before the first. */
error_deg: number | null, } | { "is": "demonstrate", } | { "is": "practise",
/** Objects that were carried. */
carried: number,
/** How many were planned. */
transfers: number, } | { "is": "rest",
/** Until its planned end, seconds; zero from then on. */
left_secs: number, } | { "is": "trial",
/** What is ready, and what is not. */
checks: Array<ReadinessCheck>,
/** Number among the session's trials, and how many there are. */
number: [number, number],
/** How the trial before went; empty before the first. */
before: string, };

/** How something ended. */
export type StepOutcome = "done" | "aborted" | "interrupted" | "skipped";

/** A step of a session. */
export type StepRow = {
/** From 1. */
step: number,
/** In a few words. */
label: string,
/** The condition that it belongs to. */
condition: string | null,
/** How it ended; none while it is to be done. */
outcome: StepOutcome | null,
/** How often it was begun. */
attempts: number,
/** What departs from the plan. */
deviations: Array<Deviation>, };

/** The arm must stand still, and why. */
export type Stop = {
/** Who died. */
source: InputSource,
/** How. */
cause: StopCause,
/** When that was noticed. */
since: SimTime,
/** As shown: what happened, and what to do if the source is back. */
reason: string, };

/** How a source died. */
export type StopCause = "silent" | "closed" | "frozen" | "flat" | "railed" | "noiseless" | "lossy" | "wrong_rate" | "lost" | "undecided" | "delayed";

/** The stream as a whole. */
export type StreamQuality = {
/** The verdict on gaps and rate. */
light: ChannelStatus,
/** Share of samples lost or unusable in the newest second. */
lost_share: number,
/** Gaps since the start. */
gaps: number,
/** Samples a second by the device's counter and the host's clock over up to five seconds; none in the first two, and
 * in the two after a silence: what had piled up comes in a burst then. */
rate_hz: number | null, };

/** What the experimenter's page asks of the trial. */
export type StudyAction = "pause" | "resume" | "abort" | "check_gaze" | "calibrate_gaze";

/** What can be asked for, as buttons of the experimenter's page are told. */
export type StudyButton = "begin" | "next" | "start_anyway" | "skip" | "redo" | "pause" | "abort" | "retrain" | "recalibrate" | "leave";

/** What whoever conducts a study asks for. */
export type StudyRequest = { "ask": "begin",
/** The participant; whose turn it is if left out. */
id?: string,
/** Somebody new. */
new?: boolean, } | { "ask": "next", } | { "ask": "start_anyway",
/** Why. */
reason: string, } | { "ask": "skip",
/** Why. */
reason: string, } | { "ask": "redo",
/** Why. */
reason: string, } | { "ask": "retrain",
/** Why. */
reason: string, } | { "ask": "recalibrate",
/** Why. */
reason: string, } | { "ask": "note",
/** The words. */
text: string, } | { "ask": "leave", };

/** A joint of the virtual hand, or its grasp, that two gestures move. */
export type TacAxis = {
/** Such as `wrist flexion`. */
name: string,
/** The gesture that moves it up. */
up: Gesture,
/** The gesture that moves it down. */
down: Gesture,
/** Its range, degrees, or per cent of a grasp. */
range: [number, number],
/** How near to the target it must be, in the same unit. */
tolerance: number,
/** In the same unit each second. */
speed: number, };

/** An axis of the virtual limb during a trial. */
export type TacAxisState = {
/** Its name, range, tolerance and gestures. */
axis: TacAxis,
/** Where it is, degrees or per cent of a grasp. */
position: number,
/** Where it should be. */
target: number, };

/** What a trial waits for. */
export type TacPhase = "relaxing" | "ready" | "moving";

/** How the test went. */
export type TacReport = {
/** All targets up to now. */
trials: Array<TacTrial>,
/** Targets of the whole test. */
asked: number,
/** Share of the targets up to now that were reached. */
completion_rate: number,
/** Mean over those that were reached, seconds; none before one was. */
mean_secs: number | null, };

/** One target, when it is over. */
export type TacTrial = {
/** What was asked for, by the axes' names. */
target: Array<[string, number]>,
/** From the first gesture to the target, seconds, the time in it at the end not counted; none if it was not reached. */
secs: number | null,
/** How often the target was left again. */
overshoots: number,
/** Shortest over travelled way, both as sums of shares of the ranges; none if nothing moved. */
path_efficiency: number | null, };

/** Where an object has to go. */
export type Target = {
/** The object that belongs here. */
object: ObjectId,
/** Centre of the disc on the table top, in `world`. */
centre: [number, number, number],
/** Radius of the disc, metres: an object counts with its centre above it. */
radius: number, };

/** The selection marker. */
export type TargetView = {
/** The highlighted object, while the hand is empty. */
object: ObjectId | null,
/** The place marker on the table top. */
place: [number, number, number] | null,
/** The selection of the current phase (object, or place while an object is held) is locked. */
locked: boolean,
/** Posterior over the objects of the scene; empty for methods without inference. */
posterior: Array<number>, };

/** What the task asks for now, where that changes in the course of a trial. */
export type TaskGoal = { "type": "disc",
/** Middle of the disc on the surface, in `world`. */
centre: [number, number, number],
/** Radius within which the object's middle counts, metres. */
radius: number, } | { "type": "ball",
/** Middle of the ball, in `world`. */
centre: [number, number, number],
/** Radius, metres. */
radius: number, } | { "type": "posture",
/** The joints that count; all others are free. */
joints: Array<JointGoal>, };

/** The tests of a model that the page shows. */
export type TestKind = "sequence" | "trial" | "motion" | "tac1" | "tac3" | "cursor";

/** A tone. */
export type Tone = {
/** Hz at the beginning, and at the end: it glides. */
hz: [number, number],
/** Milliseconds. */
ms: number, };

/** How a tracking source stands: for the page of tracking and for `doctor`. */
export type TrackingReport = {
/** As the source was named, such as `vrpn:192.168.1.5/Shoulderpad`. */
source: string,
/** The body that is followed. */
body: string,
/** All bodies that were seen, in alphabetical order. */
bodies: Array<string>,
/** Poses of the body per second, over the last two seconds. */
rate_hz: number,
/** Since the last pose that can be used, s; none before the first. */
age_secs: number | null,
/** What the last ten seconds were like; none before there are enough poses. */
stream: PoseStreamStatistics | null,
/** Noise of turns, standard deviation about one axis, rad; none before there are enough. */
noise_rad: number | null,
/** Noise of places, standard deviation of one axis, m; none before there are enough. */
noise_m: number | null,
/** Messages that could not be read. */
malformed: number,
/** The newest pose that can be used: `tracking_from_body`, metres with z up. */
tracking_from_body: Pose | null,
/** Where the frame of the tracking system is taken to be; none before the body was first seen. */
world_from_tracking: Pose | null,
/** Where that puts the shoulder. */
world_from_shoulder: Pose | null,
/** The calibrations that are in use. */
calibrations: Array<ActiveCalibration>,
/** How the headset's world stands in the room; none without a calibrated headset. */
headset: string | null,
/** How the person's own limb is followed; none where it is not tracked. */
limb: string | null,
/** How the person sits, against how they sat when the shoulder was calibrated; none without a calibration. */
posture: string | null,
/** What is in reach from where the shoulder is at the start of a trial; none before one is prepared. */
reach: ReachGrid | null,
/** Why the arm does not follow, and what to do about it; none while all is well. */
fault: string | null,
/** The same as a key, such as `millimetres`, `waiting`, `no_body`, `silent` or `occluded`. */
fault_name: string | null, };

/** Something that happened at one tick. */
export type TrialEvent = {
/** When. */
time: SimTime, } & ({ "event": "gesture_changed",
/** The new one. */
gesture: Command, } | { "event": "emg_gap",
/** Gaps in the samples. */
gaps: number,
/** Samples that could not be used. */
unusable_samples: number,
/** Windows left out. */
rejected_windows: number, } | { "event": "stopped",
/** Which source. */
source: InputSource,
/** How it died. */
cause: StopCause,
/** As shown. */
reason: string, } | { "event": "rearmed" } | { "event": "base_held",
/** From the base to where it was told to be, metres. */
distance: number, } | { "event": "base_follows" } | { "event": "contacts_unsolved" } | { "event": "grasp_made",
/** Which object. */
object: ObjectId,
/** Links of fingers that touched it. */
links: Array<string>,
/** The object's centre, `world`, m. */
place: [number, number, number], } | { "event": "grasp_ended",
/** Which object. */
object: ObjectId,
/** Links of fingers that touched it when it was taken. */
links: Array<string>,
/** The object's centre, `world`, m. */
place: [number, number, number], } | { "event": "grasp_failed",
/** The object that it closed on; none if nothing was near. */
object: ObjectId | null,
/** Why. */
reason: GraspFault, } | { "event": "gaze_unusable" } | { "event": "object_attached",
/** Which object. */
object: ObjectId, } | { "event": "object_released",
/** Which object. */
object: ObjectId, } | { "event": "locked",
/** The object, or none for a place. */
object: ObjectId | null, } | { "event": "unlocked" } | { "event": "plan_requested",
/** Number of the request in this trial. */
request: number, } | { "event": "plan_finished",
/** Number of the request in this trial. */
request: number,
/** How it ended. */
status: PlanStatus,
/** One sentence when there is no full plan. Of a start or goal in collision it names both
 * links, or the link and the obstacle. */
reason?: string, } | { "event": "plans_failed",
/** How many. */
count: number,
/** Why the last one failed. */
reason: string, } | { "event": "method_note",
/** What it says. */
text: string, } | { "event": "motion_stopped" } | { "event": "motion_finished" } | { "event": "object_on_target",
/** Which object. */
object: ObjectId,
/** Horizontal distance from its target's centre, metres. */
distance: number, } | { "event": "object_off_target",
/** Which object. */
object: ObjectId, } | { "event": "object_crossed",
/** Which object. */
object: ObjectId, } | { "event": "objects_refilled",
/** How many. */
count: number, } | { "event": "goal_reached",
/** Which goal of the trial, from 1. */
number: number, } | { "event": "goal_missed",
/** Which goal of the trial, from 1. */
number: number, } | { "event": "practice_finished" } | { "event": "trial_finished" });

/** Whether the trial goes on, and what the record of it is called. */
export type TrialStatus = {
/** Simulated time stands still. */
paused: boolean,
/** The trial was ended before its time. */
aborted: boolean,
/** The experimenter's buttons have an effect. */
can_pause: boolean,
/** Simulated time has not begun: it waits for the person's first action. */
waiting: boolean,
/** Simulated time stands still, because who drives reads a dialog. */
held: boolean,
/** What may be asked for when the trial is over. */
offers: Array<PostTrialAction>,
/** Results of this trial, once it is over, and of those before it, the newest first. */
results: Array<ResultCard>,
/** Seed of the trial, as text: JavaScript has no whole numbers above 2^53. */
seed: string,
/** Where it is recorded; none if it is not. */
record: string | null,
/** What gives gaze instead of the page's mouse and headset, such as an eye tracker; none if nothing does. */
gaze_source: string | null,
/** How often the experimenter has asked for a gaze check. With each, the participant's page begins one. */
gaze_checks: number,
/** The same for a calibration of the gaze. */
gaze_calibrations: number,
/** Why what was chosen on the page did not begin, as a sentence; none if it did. */
refused: string | null, };

/** What the list says of a trial. */
export type TrialSummary = {
/** What it is called. */
name: string,
/** Control method. */
method: string,
/** Set-up. */
setup: string,
/** Seed, as text: JavaScript has no whole numbers above 2^53. A bag has none. */
seed: string | null,
/** Length, simulated seconds. */
seconds: number,
/** What the task counted in the end. */
score: number, };

/** A buzz. */
export type Vibration = {
/** 0 to 1. Zero ends the one before. */
strength: number,
/** Milliseconds; a later one for the same digit takes its place. */
ms: number, };

/** A drawn shape of a link. */
export type Visual = {
/** `link_from_visual`. */
pose: Pose,
/** What is drawn. */
geometry: VisualGeometry,
/** Red, green, blue, alpha, 0 to 1. */
colour: [number, number, number, number], };

/** What is drawn. */
export type VisualGeometry = { "shape": Shape } | { "mesh": {
/** Such as `package://proact_description/meshes/palm.stl`. */
file: string,
/** Along x, y, z. */
scale: [number, number, number], } };
