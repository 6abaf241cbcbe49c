// What the pages say, in one place: a lab translates this file and builds the page again (docs/user_guide.md, "In another
// language"). A text with values in it is a function of them.

// --- The participant's page -------------------------------------------------------------------------------------------------------

const signals = {
  title: "Signals",
  rows: "Signals over time: drag, or use the arrow keys, to look back",
  slider: "Seconds before now",
  pause: "Pause",
  live: "Live",
  close: "Close",
  isLive: "live",
  isBack: (seconds: string) => `${seconds} s back`,
  noEmg: "Gestures come from keys: this trial has no EMG.",
  emg: "EMG",
  classes: "Gesture probabilities",
  gesture: "Gesture",
  meant: "Meant",
  gaze: "Gaze on the table",
  gazeAhead: "ahead",
  gazeSide: "left",
  joints: "Joints",
  lowLimit: "low limit",
  highLimit: "high limit",
  place: "place",
  locked: (name: string) => `${name}, locked`,
};

const views = {
  hand: "Hand",
  eyes: "Eyes",
};

const scores = {
  title: "Scores by method",
  close: "Close",
  csv: "Save as CSV",
  you: "This visit",
  simulated: "Simulated people",
  legend: "Dot and line: mean and 95 % interval",
  method: "Method",
  who: "Who",
  trials: "Trials",
  measures: { score: "score", seconds: "time, s", attempts: "attempts to grip", path: "path of the wrist, m" },
  plot: (measure: string) => `${measure} by method; the table below has the numbers`,
  about: (trials: number) => `${trials === 1 ? "One trial" : `${trials} trials`} of this visit. Means, and in brackets 95 % intervals where there are two trials or more.`,
  none: "No trial of this visit is over yet. Means, and in brackets 95 % intervals.",
  aboutPeople: (people: number) =>
    `Simulated people: ${people}, one trial each by each method; they are no evidence about people. Their path is that of trials that they finished in time.`,
  noPeople: "No simulated people have tried this task and set-up.",
};

const captions = {
  label: "Sounds",
  locked: "lock: high tick",
  unlocked: "lock off: low tick",
  no_plan: "no way: two low buzzes",
  trial_over: "trial over: rising chord",
  contact_made: "contact",
  contact_lost: "contact lost",
  on_target: "on target: bell",
  off_target: "off target: falling tone",
  pressure: "pressure",
  grip: "grip: hum",
};

const refused = {
  close: "Close",
};

const intent = {
  title: "Which block is meant",
  titlePlaces: "Whose place is meant",
  column: "",
  gaze: "Gaze",
  task: "Task",
  both: "Both",
  over: "Bars in the scene: left gaze alone, right both",
  nothing: "This method does not ask what is meant, or there is no gaze yet.",
  tooMany: "Too many blocks for a bar each.",
  gazeActs: "This method goes by the gaze alone; the task is shown beside it.",
  bothAct: "This method goes by both.",
  placesAct: "For comparison: the method takes the place that is looked at.",
};

export const strings = { signals, views, scores, captions, refused, intent };
