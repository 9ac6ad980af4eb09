// Generated from the server's types by `ROBERT_BLESS=1 cargo test -p robert-studio protocol`; do not edit.
// Values are rad, m, s and frames of 1/20 s.

/** Any JSON. */
export type Json = null | boolean | number | string | Json[] | { [name: string]: Json };

/** A frame that is fixed to a body. */
export interface Anchor {
  /** Index of the body. */
  link: number;
  /** Position in the body's frame, m. */
  pos: [number, number, number];
  /** Orientation in the body's frame, w x y z. */
  quat: [number, number, number, number];
}

/** The position and the axis of a joint. */
export interface AxisFacts {
  /** Direction, in the body's frame. */
  axis: [number, number, number];
  /** The body that it moves. */
  body: number;
  /** A point on the axis, in the body's frame, m. */
  pos: [number, number, number];
}

/** Arguments of `batch`. */
export interface Batch {
  /** The name of this edit in the history. */
  label?: string;
  /** The edits, in order. */
  ops: Op[];
}

/** A collection that was begun and is not complete yet. */
export interface BegunCard {
  /** The agents that collect. */
  agents: string[];
  /** Folder, relative to the studio's. */
  path: string;
  /** Robot. */
  robot: string;
  /** Frames that are wanted. */
  transitions: number;
}

/** The panels beside the clip in a picture or film. */
export type Beside =
  /**
   * The number of a take, which is performed again: the same clip, policy and seed give the same
   * bits.
   */
  | { take: number }
  /**
   * Another clip, performed by the same policy, or a take in a file; relative to the
   * studio's folder.
   */
  | { file: string };

/**
 * A run of steps at which the policy sees no goal. Commands `after` and `before` are visible (or
 * are the ends of the clip), and none between them is.
 */
export interface Blind {
  /** Last visible frame before; null at the start of the clip. */
  after: number | null;
  /** First visible frame after; null when the clip ends masked. */
  before: number | null;
  /** First blind step. */
  from: number;
  /** Step after the last blind one. */
  to: number;
}

/** Arguments of `blocks.delete`. */
export interface BlocksDelete {
  /** The first frame of the block. */
  frame: number;
}

/** Arguments of `blocks.insert`. */
export interface BlocksInsert {
  /**
   * The frame before which the block is inserted; the clip's length appends. If the frame is
   * inside a block, the new one comes after that block.
   */
  at: number;
  /** Frames of the smooth curves that lead to the block and from it. */
  blend?: number;
  /** Its name. */
  name: string;
  /** The motion. */
  part: Part;
}

/** Arguments of `blocks.order`. */
export interface BlocksOrder {
  /** The first frames of all blocks, in their new order. */
  frames: number[];
}

/** Arguments of `blocks.repeat`. */
export interface BlocksRepeat {
  /** Frames of the smooth curve from the block's end to its beginning. */
  blend?: number;
  /** The first frame of the block. */
  frame: number;
}

/** A body of a robot. */
export interface BodyFacts {
  /** State joints that move it against its parent. */
  joints: number[];
  /** Its name. */
  name: string;
  /** Its parent; 0 is the world. */
  parent: number;
}

/** The default view, as in `MuJoCo`'s free camera. */
export interface Camera {
  /** Direction of view about z from +x, rad. */
  azimuth_rad: number;
  /** Distance from it, m. */
  distance: number;
  /** Direction of view against the horizon, rad; negative looks down. */
  elevation_rad: number;
  /** Vertical field of view, rad. */
  fovy_rad: number;
  /** The point at the centre of the view, m. */
  lookat: [number, number, number];
}

/**
 * A keyframe animation for a torque-controlled robot: which poses it should reach and when, and
 * which frames are left to the policy.
 */
export interface Clip {
  /**
   * The fill after keys without their own, up to the next key of each joint: mask (nothing), linear, cubic or
   * hold.
   */
  fill?: Fill;
  /** Name and major version of this format. */
  format: Format;
  /** Frames per second; always 20. */
  fps: number;
  /** Keyframes, at most one per frame. */
  keys: Key[];
  /** Number of frames. */
  length: number;
  /** Named moments and blocks, at most one per frame. */
  markers?: Marker[];
  /** Spans without a goal, regardless of keys and fills. */
  masks?: Mask[];
  /** A title. */
  name?: string;
  /** Remarks. */
  notes?: string;
  /** Values that are added to the command of the keys, at most one offset per frame. */
  offsets?: Offset[];
  /** Named poses: one value per joint, or null for a joint that the pose says nothing about. */
  poses?: Record<string, (number | null)[]>;
  /** The robot that the clip was made for. */
  robot: Robot;
  /** The state before frame 0; without it, the values of the first key. */
  start?: Start;
  /** Extensions of other programs; kept, never read. */
  x?: Record<string, Json>;
}

/** Arguments of `clip.length`. */
export interface ClipLength {
  /**
   * Remove keys, offsets and markers beyond the new end; otherwise the edit is refused. Masks and blocks
   * that go on beyond it end there.
   */
  cut?: boolean;
  /** Frames. */
  length: number;
}

/** Arguments of `clip.notes`. */
export interface ClipNotes {
  /** The remarks. */
  notes: string;
}

/** Query of `POST /api/clips`. */
export interface ClipQuery {
  /** The name of the file in the body; its suffix determines the format. */
  name?: string;
  /** A file of this machine instead of a body. */
  path?: string;
  /** Rows per second, for LAFAN files, which do not contain it. */
  rate?: number;
  /** The robot, for formats that do not name theirs; if absent, that of the open document. */
  robot?: string;
}

/** Arguments of `clip.rename`. */
export interface ClipRename {
  /** The title. */
  name: string;
}

/** Arguments of `clip.start`. */
export interface ClipStart {
  /** The start; null = the first key's values. */
  start?: Start | null;
}

/** Two points that a constraint holds together. */
export interface Closure {
  /** The points. */
  ends: [Anchor, Anchor];
  /** Whether their orientations are the same, too. */
  turns: boolean;
}

/** The kind of a refusal. */
export type Code =
  /** A file, a value or an edit is wrong. */
  | "invalid"
  /** A request is malformed. */
  | "request"
  /** No token. */
  | "unauthorized"
  /** The sender may not ask for this. */
  | "forbidden"
  /** There is no such thing. */
  | "not_found"
  /** No clip is open. */
  | "no_document"
  /** The clip needs a file name first. */
  | "untitled"
  /** A file of that name exists. */
  | "exists"
  /** Another program has changed the file meanwhile. */
  | "changed"
  /** Another studio has it. */
  | "locked"
  /** The simulation is down. */
  | "worker"
  /** A body is too large. */
  | "too_large"
  /** A cap was reached. */
  | "full"
  /** It was tried and failed. */
  | "failed";

/** The slopes before and after a key. */
export interface Corner {
  /** The slope with which the curve arrives, rad/s or m/s. */
  in: number;
  /** The slope with which it leaves, rad/s or m/s. */
  out: number;
}

/**
 * Joints that one actuator moves together: a tendon, or a mimic joint and its leader.
 * They agree when (q - offset) / coef is the same for all.
 */
export interface Coupling {
  /** What holds them together. */
  kind: CouplingKind;
  /** The joints. */
  members: CouplingMember[];
  /** Tendon or leader name. */
  name: string;
  /** Allowed difference between members, rad or m. Contact and limits separate them a little. */
  tolerance: number;
}

/** What holds coupled joints together. */
export type CouplingKind =
  /** An actuator pulls all of them; contact can still set them apart. */
  | "tendon"
  /** A joint follows another one. */
  | "mimic";

/** One joint of a coupling: `q = coef * shared + offset`. */
export interface CouplingMember {
  /** Its share. */
  coef: number;
  /** The joint. */
  joint: string;
  /** Added to it, rad or m. */
  offset: number;
}

/** Collected data on disk. */
export interface DataCard {
  /** Trajectories. */
  episodes: number;
  /** Transitions. */
  frames: number;
  /** Folder, relative to the studio's. */
  path: string;
  /** Robot. */
  robot: string;
  /** The hash by which model cards name it. */
  sha256: string;
}

/** A difference. Empty parts did not change. */
export interface Delta {
  /** Default fill. */
  fill?: Fill;
  /** Keys that are added or changed. */
  keys_put?: Key[];
  /** Frames whose key is removed. */
  keys_removed?: number[];
  /** Length. */
  length?: number;
  /** All markers. */
  markers?: Marker[];
  /** All mask spans. */
  masks?: Mask[];
  /** Title. */
  name?: string;
  /** Remarks. */
  notes?: string;
  /** All offsets. */
  offsets?: Offset[];
  /** Poses that are added or changed. */
  poses_put?: ([string, (number | null)[]])[];
  /** Poses that are removed. */
  poses_removed?: string[];
  /** Start; null removes it. */
  start?: Start | null;
}

/** The joint that an edit demands most of. */
export interface Demand {
  /** The frames of the two goals between which it must move. */
  frames: [number, number];
  /** Its name. */
  joint: string;
  /** The speed that the plant can sustain, rad/s or m/s, if known. */
  max: number | null;
  /** Mean speed between them, rad/s or m/s. */
  needed: number;
  /** Its unit. */
  unit: Unit;
  /** The speed that 99 of 100 frames of the policy's data stay below, rad/s or m/s, if known. */
  usual: number | null;
}

/** The open document. */
export interface DocumentView {
  /** `robert-clip/1` as a JSON value. */
  clip: Clip;
  /** Unsaved edits exist. */
  dirty: boolean;
  /** Problems and timeline. */
  findings: Findings;
  /** History. */
  history: History;
  /**
   * Increases with every document that is opened. Choices of a page in one document (range,
   * selection, takes) have no meaning in the next.
   */
  opened: number;
  /** Its file. */
  path: string | null;
  /** Policies as its robot can have them. */
  policies: PolicyCard[];
  /** Unsaved edits that came back and that nobody expects: show the banner. */
  restored: Restored | null;
  /** Version. */
  rev: number;
  /** Facts about its robot that the timeline needs; joints in the order of the clip. */
  table: JointTable;
}

/** A clip that was never saved. */
export interface Draft {
  /** Whether the studio was killed with it open, and it has not been opened since. */
  abandoned: boolean;
  /** Seconds since 1970 of its last edit. */
  changed_secs: number;
  /** Keys. */
  keys: number;
  /** Title of the clip. */
  name: string;
  /** For `POST /api/drafts/{number}`. */
  number: number;
  /** Robot. */
  robot: string;
}

/** The path that follows a drawn line. */
export interface DrawAnswer {
  /** Frames until the last key ends. */
  frames: number;
  /** Keys, joined by straight lines; frames count from the beginning of the line. */
  keys: DrawnKey[];
  /** The line in the world, m. */
  line: [number, number, number][];
  /** The largest distance between site and line where the line leaves the robot's reach, m. */
  off_m: number;
}

/** Body of `POST /api/draw`: a line that a person drew over a page's 3D view. */
export interface DrawRequest {
  /** Joints that must stay. */
  locked?: string[];
  /** The plane in which the line is drawn. */
  plane: Plane;
  /**
   * Points of the picture, 0 to 1 from the top left corner, with the time at which each was
   * drawn, s.
   */
  points: [number, number, number][];
  /** The pose at which the line begins, one value per state joint. */
  q: number[];
  /** The duration of the whole line at constant speed, s; if absent, as long as the drawing took. */
  secs?: number;
  /** The site that goes along the line. */
  site: string;
  /** The page. */
  tab: string;
  /** Allowed distance between path and line, m. */
  tolerance_m: number;
}

/** A key of a drawn line. */
export interface DrawnKey {
  /** Frames after the line was begun. */
  frame: number;
  /** Frames that it is held. */
  hold: number;
  /** One value per state joint. */
  q: number[];
}

/** The effect of an edit. */
export interface Edited {
  /** Unsaved edits exist. */
  dirty: boolean;
  /** Labels and position. */
  history: History;
  /** Problems that are known without simulation. */
  lints: Lint[];
  /** The changes, step by step; empty if nothing changed. */
  patches: Delta[];
  /** Version afterwards. */
  rev: number;
}

/** A refusal. */
export interface ErrorBody {
  /** Its kind. */
  code: Code;
  /** A way to solve the problem, if the message does not contain it. */
  mend?: string;
  /** The sentence that the command line prints after `error: `. */
  message: string;
  /** The place, for files. */
  place?: Place;
}

/** Server → client on the socket. */
export type Event =
  /** First of all. */
  | { event: "hello"; client: number; state: State }
  /** A change of the document. */
  | { event: "edit"; by: number; dirty: boolean; first_changed_frame: number | null; first_changed_step: number | null; history: History; id?: number; label: string; patch: Delta; rev: number }
  /** The answer to a request that is not an edit, or that was refused. */
  | { event: "reply"; error?: ErrorBody; id: number; result?: Outcome }
  /** Another document, or this one afresh. */
  | { event: "document"; document: DocumentView | null }
  /** Saved. */
  | { event: "saved"; path: string; rev: number }
  /** Problems and timeline. */
  | ({ event: "findings" } & Findings)
  /** Rollout settings changed. */
  | { event: "rollout.settings"; auto: boolean; guide: Guide; model_path?: string; policy: PolicyName; refine: boolean; seed: number }
  /** New frames. */
  | { event: "rollout.frames"; error: (number | null)[]; from: number; gen: number; q: number[][] }
  /** The progress of the rollout. */
  | ({ event: "rollout.state" } & RolloutState)
  /** Takes, and which are compared. */
  | ({ event: "takes" } & TakesView)
  /** State of the simulation. */
  | ({ event: "worker" } & WorkerState)
  /** State of a job. */
  | ({ event: "job" } & JobView)
  /** Something was selected. */
  | { event: "select"; body?: string; joint?: string; site?: string }
  /**
   * A person turns a joint in the viewport. If `done` is true the mouse was released, and the
   * page makes the edit.
   */
  | { event: "joint"; done: boolean; tab?: string; values: Record<string, number> }
  /** The drag in the viewport was cancelled, so the page makes no edit. */
  | { event: "joint.cancelled"; tab?: string }
  /** Joints that are locked: no drag moves them. */
  | { event: "locked"; joints: string[] }
  /** Sites that inverse kinematics keeps in place. */
  | { event: "pinned"; pins: Pin[] }
  /** A point of the drawn path was clicked or dragged: the playhead goes to its frame. */
  | { event: "path.point"; frame: number; tab?: string; values: Record<string, number> | null }
  /** A sentence for a banner. */
  | { event: "notice"; level: Level; message: string };

/** Query of `GET /api/gallery-picture.jpg` and `/api/gallery-error`. */
export interface ExampleQuery {
  id: string;
}

/** A format of `GET /api/formats`. */
export interface ExportFormat {
  /** What is in it, and for whom. */
  about: string;
  /** Ending of its file. */
  ending: string;
  /** For `ExportRequest`. */
  format: string;
  /** What becomes of it. */
  kind: ExportKind;
  /** What people call it. */
  title: string;
  /** Why the robot of the open clip cannot have it; null if it can. */
  why: string | null;
}

/** What becomes of an export. */
export type ExportKind =
  /** A film of the performed clip. */
  | "film"
  /** A picture of it. */
  | "picture"
  /** A file of the motion. */
  | "take"
  /** A folder, which is written on the studio's disk and cannot be downloaded. */
  | "folder"
  /** Made from the clip alone, at once and without performing it. */
  | "clip";

/** Query of `GET /api/export`. */
export interface ExportQuery {
  format: string;
}

/** Body of `POST /api/exports`. */
export interface ExportRequest {
  /** fit, fixed, top, orbit, or a camera of the model. */
  camera?: string;
  /** The chart that is drawn beside it. */
  compare?: Beside;
  /** One of `GET /api/formats`. */
  format: string;
  /** Frames `[from, to)`, for films; the frame `from`, for a picture. */
  frames?: [number, number];
  /** Moments of a strip. */
  moments?: number;
  /** The robot that is laid over the picture. */
  overlay?: string;
  /**
   * The file to write, relative to the studio's folder; without it the result is fetched
   * from the job.
   */
  path?: string;
  /** Whether another file of that name is to be replaced. */
  replace?: boolean;
  /** Pixels, for pictures and films. */
  size?: [number, number];
}

/** A file that can be opened. */
export interface FileCard {
  /** Bytes. */
  bytes: number;
  /** Seconds since 1970 of its last change. */
  changed_secs: number;
  /** A summary; for clips of a moderate size. */
  clip?: Peek;
  /** The kind of the file, judged by its name. */
  kind: FileKind;
  /** Its name. */
  name: string;
  /** Why it cannot be opened. */
  why?: string;
}

/** The kind of a file, judged by its name. */
export type FileKind =
  /** `robert-clip/1`. */
  | "clip"
  /** Frames and joints as a table. */
  | "csv"
  /** Keys of an MJCF. */
  | "mjcf"
  /** A ROS 2 JointTrajectory. */
  | "ros"
  /** LAFAN rows: recorded motion without header or rate. */
  | "lafan"
  /** A take: the motion that it reached. */
  | "take";

/** Query of `GET /api/files`. */
export interface FilesQuery {
  /** Below it. */
  dir?: string;
  /** A folder that the user typed; the studio's folder if it is absent. */
  root?: string;
}

/** The command after the hold of a key, up to the next key of each joint. */
export type Fill =
  /** Nothing; the policy decides. The paper's keyframe mode. */
  | "mask"
  /** The straight line to the joint's next key. */
  | "linear"
  /**
   * Monotone cubic to the joint's next key (no overshoot, zero slope at holds and ends), unless a key
   * has a tangent.
   */
  | "cubic"
  /** This key's value until the joint's next key. */
  | "hold";

/** Arguments of `fill.set`. */
export interface FillSet {
  /** The fill; null = the clip's default (`mask` for the default itself). */
  fill?: Fill | null;
  /**
   * The keys after which the fill is set, for each of their joints up to its next key; absent = the clip's
   * default.
   */
  frames?: number[];
}

/** Problems and the compiled timeline. */
export interface Findings {
  /** Runs of frames without any goal in the window. */
  blind: Blind[];
  /** The masks that the policy in use accepts. */
  granularity: Granularity;
  /** Problems, worst first, each with its fixes (ready-made `op`s). */
  lints: Lint[];
  /** The version they are about. */
  rev: number;
  /** Whether simulation has judged every pose. It judges the first 4,000 different poses of a clip. */
  simulated: boolean;
  /** Spans of frames of one kind, without gaps from the first frame to the last. */
  spans: Span[];
}

/** An edit that removes a finding. */
export interface Fix {
  /** The edit. */
  op: Op;
  /** Its text on a button. */
  title: string;
}

/** The coupling of a joint to another: q = offset + multiplier * q of the leader. */
export interface Follow {
  /** Index of the leader. */
  leader: number;
  /** Factor. */
  multiplier: number;
  /** Added, rad or m. */
  offset: number;
}

export type Format = "robert-clip/1";

/** One example. */
export interface GalleryItem {
  /** Whether it is one of the few examples that the start page shows large. */
  featured: boolean;
  /** For `POST /api/gallery/{id}`. */
  id: string;
  /** Keys. */
  keys: number;
  /** Frames. */
  length: number;
  /** Title. */
  name: string;
  /** Robot. */
  robot: string;
}

/** The shape of a robot. */
export interface Geometry {
  /** Body names, the world first. */
  bodies: string[];
  /** Body transforms in the home pose; (nbody, 7) position and quaternion w x y z. */
  home: number[];
  /** Meshes, in order of bodies. */
  meshes: MeshFacts[];
  /** The robot. */
  robot: string;
}

/** The masks that a policy allows: whole frames, or single joints. */
export type Granularity =
  /** Whole frames only, as in the paper. */
  | "state"
  /** Single joints of a frame. */
  | "joint";

/** A group of joints: a finger, a limb, all knuckles. */
export interface Group {
  /** Members in state order. */
  joints: string[];
  /** Short name. */
  name: string;
  /** Name for people. */
  title: string;
}

/** The rule that fills masked frames before a policy sees them. */
export type Guide =
  /** Nothing: the policy sees the mask. */
  | "none"
  /** The straight line from the reached state to the next goal, drawn anew in every frame. */
  | "linear"
  /**
   * A smooth curve from goal to goal through the whole gap, planned before the rollout; in dropouts of a recording
   * the most likely motion.
   */
  | "smooth";

/** The named history. */
export interface History {
  /** The number of edits that are done; the rest can be redone. */
  done: number;
  /** Number of the first label, from 0. */
  first: number;
  /** The names of the last edits, oldest first (at most 100). */
  labels: string[];
  /** The number of edits. */
  len: number;
}

/** The figures of one hold. */
export interface HoldError {
  /** Mean error in its last frame, rad or m. */
  end_error: number;
  /** First commanded frame of the hold. */
  frame: number;
  /** Frames until all joints with a goal were within 0.05 rad or m; null when never. */
  late_frames: number | null;
  /** Its length in frames. */
  length: number;
}

/** Query of `GET /api/hover`. */
export interface HoverQuery {
  tab: string;
  x: number;
  y: number;
}

/** The part of the robot that is under a pointer. */
export interface Hovered {
  /** The body. */
  body: string;
  /** The joint that moves it, if one does. */
  joint: string | null;
}

/** The result of inverse kinematics. */
export interface IkAnswer {
  /** Bodies that touch in the pose, and the depth, m; the deepest first. */
  contacts: [string, string, number][];
  /** Distance left to the target, m; 0 if there is no target. */
  distance_m: number;
  /** Distance left by pin, m. */
  pins_m: number[];
  /** One value per state joint, inside the limits. */
  q: number[];
  /** Whether the target was reached and every pin is met. */
  reached: boolean;
}

/** Body of `POST /api/ik`. */
export interface IkRequest {
  /** Instead of a site: a body by name, and a point in its frame, m. */
  body?: [string, [number, number, number]];
  /** Joints that must stay. */
  locked?: string[];
  /** Sites that are held meanwhile. */
  pins?: Pin[];
  /** The target of the point in the world, m; if it is absent, only the pins count. */
  pos?: [number, number, number];
  /** The pose at which the search starts, one value per state joint. */
  q: number[];
  /** Orientation, w x y z; absent = free. */
  quat?: [number, number, number, number];
  /** The site that is pulled. */
  site?: string;
}

/** Body of `POST /api/import`. */
export interface ImportBody {
  /** As `robert import --actuators` has it. */
  actuators?: string;
  /** As `robert import --drives` has it. */
  drives?: string;
  /** The URDF or MJCF: among the uploaded files, or on this machine. */
  file: string;
  fixed_base?: boolean;
  id: string;
  uploaded?: boolean;
  /** Bodies to leave out, with their children. */
  without?: string[];
}

/** Query of `POST /api/insert`. */
export interface InsertQuery {
  /** The frame before which it is inserted. */
  at: number;
  /** Frames of the smooth curves that lead to the block and from it. */
  blend?: number;
  /** The name of the file in the body; its suffix determines the format. */
  name?: string;
  /** A file of this machine instead of a body. */
  path?: string;
  /** Rows per second, for LAFAN files, which do not contain it. */
  rate?: number;
}

/** One line that a command writes with `--jsonl`, for the program that started it. */
export type JobEvent =
  /** A report of progress. */
  | ({ event: "progress" } & JobProgress)
  /** Figures for curves, with the `step` that they belong to. */
  | { event: "figures"; figures: Record<string, Json> }
  /** A line worth keeping. */
  | { event: "log"; line: string }
  /** The last event: the document that the command prints with `--json`. */
  | { event: "result"; result: Json };

/** A kind of job. */
export type JobKind =
  /** Gather motion without reward. */
  | "collect"
  /** Train a network. */
  | "train"
  /** Measure policies. */
  | "eval"
  /** Render a picture or a film. */
  | "render"
  /** Write a take in another format. */
  | "export"
  /** Makes a robot's folder from a model file. */
  | "import";

/** The state of a job. */
export type JobPhase =
  /** It runs. */
  | "running"
  /** It was asked to stop. */
  | "cancelling"
  /** It ended well. */
  | "done"
  /** The job ended after a request to stop, with a checkpoint. */
  | "interrupted"
  /** It ended badly. */
  | "failed";

/** The progress of a job. */
export interface JobProgress {
  /** Units finished. */
  done: number;
  /** Current figures. */
  note: string;
  /** Seconds since this part began. */
  secs: number;
  /** Units in this part. */
  total: number;
  /** The unit that is counted, such as `steps`. */
  unit: string;
  /** The part of the job that runs. */
  what: string;
}

/** `POST /api/jobs`. */
export interface JobRequest {
  /** Arguments as on the command line, without `--jsonl`. */
  args: string[];
  /** The kind of job. */
  kind: JobKind;
}

/** A job as the page sees it. */
export interface JobView {
  /** Its arguments. */
  args: string[];
  /** Other events so far. */
  events: number;
  /** Exit code, when it has ended. */
  exit: number | null;
  /**
   * The name of the file that it makes, for `GET /api/jobs/{id}/file`; available when the job is
   * done.
   */
  file: string | null;
  /** Number of the first event in `lines`. */
  first: number;
  /** Number. */
  id: number;
  /** The kind of job. */
  kind: JobKind;
  /** The newest other event. */
  last: JobEvent | null;
  /** Events, in `GET /api/jobs/{id}` only. */
  lines: JobEvent[];
  /** The last lines of its log. */
  log: string[];
  /** The state of the job. */
  phase: JobPhase;
  /** The progress of the job: the newest `progress` event. */
  progress: JobProgress | null;
  /** Seconds it has run. */
  secs: number;
  /** The purpose of the job, in words. */
  title: string;
}

/** A joint of a body. */
export interface JointAxis {
  /** The direction of the axis in the body's frame; length 1. */
  axis: [number, number, number];
  /** The joint that it follows without a motor of its own. */
  follows: Follow | null;
  /** The motion that it allows. */
  motion: JointMotion;
  /** A point of the axis in the body's frame, m. */
  pos: [number, number, number];
  /** Lowest and highest value, rad or m; null = unbounded. */
  range: [number, number] | null;
  /** The joint value at which the body is placed as `LinkFrame` says, rad or m. */
  reference: number;
}

/** One joint coordinate. */
export interface JointFacts {
  /** The range of 98 of 100 frames of the data that the robot's policy learned from, rad or m. */
  band: [number, number] | null;
  /** Whether no motor moves this joint together with others, but for those of its couplings. */
  moves_alone: boolean;
  /** Its name. */
  name: string;
  /** Lowest and highest position, rad or m; null = unbounded. */
  range: [number, number] | null;
  /** Highest speed that the plant can sustain, rad/s or m/s, if known. */
  speed_max: number | null;
  /** Speed that 99 of 100 of those frames stay below, rad/s or m/s. */
  speed_usual: number | null;
  /** Its unit. */
  unit: Unit;
}

/** The motion that a joint allows. */
export type JointMotion =
  /** Turns its body about the axis. */
  | "hinge"
  /** Shifts its body along the axis. */
  | "slide";

/** A robot as clips see it. */
export interface JointTable {
  /** Couplings. */
  couplings: Coupling[];
  /** The masks that the current policy allows. */
  granularity: Granularity;
  /** Joints in state order. */
  joints: JointFacts[];
  /** Bodies and joint axes in space, for end-effector goals; null if they are not known. */
  kinematics: Kinematics | null;
  /** Mirror table or reason. */
  mirror: Mirror;
  /** Sha-256 of its model, 64 hex digits, if known. */
  model_sha256: string | null;
  /** The rest pose, in state order. */
  rest: number[];
  /** Robot id. */
  robot: string;
}

/**
 * A keyframe: a named pose, values, or end-effector goals. If it has `reach` and also a pose or
 * values, the robot stays near these.
 */
export interface Key {
  /**
   * The fill after the hold, for each joint up to the next key with a value for it; the clip's `fill` when
   * absent.
   */
  fill?: Fill;
  /** The frame of the key, from 0. */
  frame: number;
  /**
   * The number of frames for which the values are commanded; 1 when absent. The next key with a value for a joint
   * ends the hold of this joint.
   */
  hold?: number;
  /** A remark. */
  note?: string;
  /** A named pose of this clip. */
  pose?: string;
  /** Values, one per joint. */
  q?: (number | null)[];
  /** End-effector goals: positions that points of the robot should reach. */
  reach?: Reach[];
  /**
   * Slopes of cubic curves at this key, by joint: "flat", "linear", or rad/s or m/s; automatic
   * when absent.
   */
  tangents?: Record<string, Tangent>;
}

/** Arguments of `keys.add`. */
export interface KeysAdd {
  /** The keys. */
  keys: Key[];
  /** Replace existing keys. */
  replace?: boolean;
}

/** Keys or markers by frame. */
export interface KeysFrames {
  /** Their frames. */
  frames: number[];
}

/** Arguments of `keys.hold`. */
export interface KeysHold {
  /** The frames of the keys. */
  frames: number[];
  /** For how many frames, at least 1; the next key with a value for a joint ends the hold of this joint. */
  hold: number;
}

/** Arguments of `keys.move`. */
export interface KeysMove {
  /** Keep the originals. */
  copy?: boolean;
  /** By how many frames. */
  df: number;
  /** The frames of the keys. */
  frames: number[];
  /** Replace existing keys. Joints that a new key has no value for keep theirs. */
  replace?: boolean;
  /** Move later keys along, to keep distances. The clip grows if necessary. */
  ripple?: boolean;
}

/** Arguments of `keys.paste`. */
export interface KeysPaste {
  /** The frame of the first pasted key. */
  at: number;
  /** Only these joints; absent = all. The others keep their command there. */
  joints?: string[];
  /** The keys; only their distances matter. */
  keys: Key[];
  /** Paste their mirror images. */
  mirrored?: boolean;
  /** Replace existing keys. Joints that a new key has no value for keep theirs. */
  replace?: boolean;
}

/** Arguments of `keys.scale`. */
export interface KeysScale {
  /** New distance divided by the old one, above 0. Frames are rounded, holds are scaled too. */
  factor: number;
  /** The frames of the keys. */
  frames: number[];
  /** The frame that does not move. */
  pivot: number;
  /** Replace existing keys. Joints that a new key has no value for keep theirs. */
  replace?: boolean;
}

/** Arguments of `keys.set`: absent parts do not change. */
export interface KeysSet {
  /** Fill; null = the clip's. */
  fill?: Fill | null;
  /** The key's frame. */
  frame: number;
  /** Hold, frames; the next key with a value for a joint ends it for this joint. */
  hold?: number;
  /** Remark. */
  note?: string;
  /** A named pose instead of values. */
  pose?: string;
  /** All values. */
  q?: (number | null)[];
  /** All end-effector goals; an empty list removes them and keeps the joint values. */
  reach?: Reach[];
  /** Single joints by name; null takes away the key's value for a joint. */
  values?: Record<string, number | null>;
}

/** Arguments of `keys.sparsify`. */
export interface KeysSparsify {
  /**
   * The frames of the keys that may be removed. The ends of each unbroken run of them stay, and
   * so do keys with a hold, a remark or a named pose.
   */
  frames: number[];
  /** Allowed distance between a joint of a removed key and the line, rad or m. */
  tolerance: number;
}

/** A robot as its geometry: bodies on hinges and slides. */
export interface Kinematics {
  /** Where bodies are held together, so that the tree has closed loops. */
  closures?: Closure[];
  /** Joints, in state order. */
  joints: JointAxis[];
  /** Bodies, the world first; every body comes after its parent. */
  links: LinkFrame[];
  /** Named points of bodies. */
  sites: SiteFrame[];
  /**
   * Joints that one tendon pulls. As far as inverse kinematics is concerned q / factor is the same for all of
   * them, as if they were equally stiff; contact may set them apart.
   */
  tendons?: Share[][];
}

/** Severity of a finding. */
export type Level =
  /** Worth knowing. */
  | "info"
  /** The motion will differ from the clip. */
  | "warning"
  /** The command cannot be performed by this robot or policy. */
  | "error";

/** Query of `GET /api/jobs/{id}`. */
export interface LinesFrom {
  from?: number;
}

/** A body. */
export interface LinkFrame {
  /** Its joints in the order in which they act. */
  joints: number[];
  /** Its name; may be empty. */
  name: string;
  /** Index of its parent; 0 for the world itself. */
  parent: number;
  /** Position in its parent's frame with all joints at their reference, m. */
  pos: [number, number, number];
  /** Orientation there, w x y z. */
  quat: [number, number, number, number];
}

/** A finding. */
export interface Lint {
  /** The frames concerned, `[from, to)`; null = the clip as a whole. */
  frames: [number, number] | null;
  /** The joints concerned. */
  joints: string[];
  /** Its severity. */
  level: Level;
  /** Fixes, best first; the JSON name is `mends`, which scripts use. */
  mends: Fix[];
  /** The message, with figures and units. */
  message: string;
  /** JSON pointer of the value to look at. */
  pointer: string;
  /** Its rule. */
  rule: Rule;
  /** Of a pose that the robot cannot hold (`Rule::Unreachable`): what it holds instead. */
  settled?: SettledPose;
}

/** A folder as the Open dialog shows it. */
export interface Listing {
  /** The folder below it; empty for itself. */
  dir: string;
  /** Files in it, by name. */
  files: FileCard[];
  /** Folders in it. */
  folders: string[];
  /** Entries with hidden or odd names, links that lead outside, other kinds of files. */
  left_out: number;
  /** There are more than are listed. */
  more: boolean;
  /** The full path of the folder. */
  root: string;
}

/** A named moment, or with `to` a named block of frames. */
export interface Marker {
  /** The frame of the marker. */
  frame: number;
  /** Its name. */
  name: string;
  /** First frame after the block; a moment when absent. */
  to?: number;
}

/** Arguments of `markers.move`. */
export interface MarkersMove {
  /** The marker's frame. */
  frame: number;
  /** Its new frame. */
  to: number;
}

/** Frames from..to (to excluded) without a goal. */
export interface Mask {
  /** First masked frame. */
  from: number;
  /** Only these joints; all when absent. */
  joints?: string[];
  /** First frame after it. */
  to: number;
}

/** Whether a mask hides whole frames or single joints. */
export type MaskGranularity =
  /** Whole frames, as in the paper. */
  | "state"
  /** Single joints; the token has one flag per joint. */
  | "joint";

/** Arguments of `mask.set`. */
export interface MaskSet {
  /** First frame. */
  from: number;
  /** The joints; absent = all. */
  joints?: string[];
  /** Hide (true) or show (false). */
  masked: boolean;
  /** Frame after the last. */
  to: number;
}

/** The errors of a performance. */
export interface MeanError {
  /** rad or m. */
  unit: Unit;
  /** Mean absolute error over unmasked frames and joints. */
  value: number;
}

/** The visible parts of one body in one colour. */
export interface MeshFacts {
  /** Its body, 0 = the world. */
  body: number;
  /** Three indices each, counter-clockwise from outside. */
  faces: number[];
  /** sRGB and opacity, 0 to 1. */
  rgba: [number, number, number, number];
  /** Corners in the body's frame, x y z each, m. */
  vertices: number[];
}

/** The mirror image of a pose as a rule for each joint, or the reason why there is none. */
export type Mirror =
  /** Row by row; joints without a row keep their value. */
  | { table: MirrorRow[] }
  /** The reason, for a greyed-out button. */
  | { none: string };

/** One row of a mirror table: `mirrored[target] = sign * q[source] + offset`. */
export interface MirrorRow {
  /** Added afterwards, rad or m. */
  offset: number;
  /** 1 or -1. */
  sign: number;
  /** The joint whose value it takes. */
  source: string;
  /** The joint that is set. */
  target: string;
}

/** Body of `POST /api/new`. */
export interface NewBody {
  length?: number;
  name?: string;
  robot?: string;
  text?: string;
}

/** A policy that is available for a robot. */
export interface Offer {
  /** Whether it is the robot's default. */
  default: boolean;
  /** The guide that should fill masked frames for it. */
  guide: Guide;
  /** Whether it computes with the robot's model. */
  knows_model: boolean;
  /**
   * The masks that it accepts: for a learned policy those it was trained with, for all others
   * any.
   */
  masks: MaskGranularity;
  /** Name of the model, if it is not the robot's default one. */
  model: string | null;
  /** The policy's name. */
  name: PolicyName;
  /** What is missing before it can be chosen; null if nothing is. */
  needs: string | null;
  /** Whether it needs seconds for a clip. */
  slow: boolean;
  /** Cases in which it is best, in a few words. */
  suits: string;
}

/** Values that are added to the command around one frame: they grow, are held, and fade. */
export interface Offset {
  /** What is added, by joint, rad or m. */
  add: Record<string, number>;
  /** The first frame at which the values are added in full. */
  frame: number;
  /** The number of frames for which the values are added in full; 1 when absent. */
  hold?: number;
  /** The number of frames over which it grows; 10 when absent, 0 = at once. */
  in?: number;
  /** The number of frames over which it fades; 10 when absent, 0 = at once. */
  out?: number;
}

/** Arguments of `offsets.move`. */
export interface OffsetsMove {
  /** Keep the originals. */
  copy?: boolean;
  /** By how many frames. */
  df: number;
  /** Which offsets. */
  frames: number[];
}

/** Arguments of `offsets.set`: absent parts do not change. */
export interface OffsetsSet {
  /** The values to add, by joint, rad or m; 0 or null removes a joint from the offset. */
  add?: Record<string, number | null>;
  /** At which frame. */
  frame: number;
  /** The number of frames for which the values are added in full. */
  hold?: number;
  /** Over how many frames it grows. */
  in?: number;
  /** Over how many frames it fades. */
  out?: number;
}

/** An edit. */
export type Op =
  /** Adds keys. */
  | { op: "keys.add"; args: KeysAdd }
  /** Changes parts of one key. */
  | { op: "keys.set"; args: KeysSet }
  /** Shifts keys in time, or copies them there. */
  | { op: "keys.move"; args: KeysMove }
  /** Scales the times of keys about a pivot. */
  | { op: "keys.scale"; args: KeysScale }
  /** Removes keys. */
  | { op: "keys.delete"; args: KeysFrames }
  /** Inserts keys from a clipboard, the first of them at `at`. */
  | { op: "keys.paste"; args: KeysPaste }
  /** Replaces keys by their mirror images. */
  | { op: "keys.mirror"; args: KeysFrames }
  /** Sets how long keys are held. */
  | { op: "keys.hold"; args: KeysHold }
  /** Gives keys with end-effector goals the joint values that reach them, in place of the goals. */
  | { op: "keys.bake"; args: KeysFrames }
  /** Removes keys that lie on the straight line between the others. */
  | { op: "keys.sparsify"; args: KeysSparsify }
  /** Masks or unmasks a span. */
  | { op: "mask.set"; args: MaskSet }
  /** Sets the fill after keys, or the clip's default. */
  | { op: "fill.set"; args: FillSet }
  /** Sets the slopes of cubic curves at keys. */
  | { op: "tangent.set"; args: TangentSet }
  /** Makes or changes the offset at a frame. */
  | { op: "offsets.set"; args: OffsetsSet }
  /** Shifts offsets in time, or copies them there. */
  | { op: "offsets.move"; args: OffsetsMove }
  /** Removes offsets. */
  | { op: "offsets.delete"; args: KeysFrames }
  /** Adds offsets to the keys for good. */
  | { op: "offsets.bake"; args: KeysFrames }
  /** Inserts a motion as a block, and blends it with what is around it. */
  | { op: "blocks.insert"; args: BlocksInsert }
  /** Puts blocks in another order. */
  | { op: "blocks.order"; args: BlocksOrder }
  /** Inserts a copy of a block after it. */
  | { op: "blocks.repeat"; args: BlocksRepeat }
  /** Removes a block with its frames. */
  | { op: "blocks.delete"; args: BlocksDelete }
  /** Inserts empty frames and shifts everything after them. */
  | { op: "time.insert"; args: TimeInsert }
  /** Removes frames with their keys and closes the gap. */
  | { op: "time.delete"; args: TimeDelete }
  /** Stores a named pose. */
  | { op: "pose.save"; args: PoseSave }
  /** Applies a pose to frames. */
  | { op: "pose.apply"; args: PoseApply }
  /** Renames a pose everywhere. */
  | { op: "pose.rename"; args: PoseRename }
  /** Deletes a pose; keys that used it keep its values. */
  | { op: "pose.delete"; args: PoseDelete }
  /** Adds a marker. */
  | { op: "markers.add"; args: Marker }
  /** Renames the marker at a frame, or sets where its block ends. */
  | { op: "markers.set"; args: Marker }
  /** Moves a marker. */
  | { op: "markers.move"; args: MarkersMove }
  /** Removes markers. */
  | { op: "markers.delete"; args: KeysFrames }
  /** Sets the title. */
  | { op: "clip.rename"; args: ClipRename }
  /** Sets the remarks. */
  | { op: "clip.notes"; args: ClipNotes }
  /** Sets the length. */
  | { op: "clip.length"; args: ClipLength }
  /** Sets the state before frame 0. */
  | { op: "clip.start"; args: ClipStart }
  /** Several edits that count as one; either all are applied or none. */
  | { op: "batch"; args: Batch }
  /** A difference between two versions, used for undo. */
  | { op: "patch"; args: Delta };

/** Body of `POST /api/ops`. */
export interface OpsRequest {
  /** The name of the edits in the history; if empty, the name of the first edit. */
  label?: string;
  /** The edits, in order; they count as one for undo. */
  ops: Op[];
}

/** The answer to a request that changed nothing. */
export type Outcome =
  /** The request was carried out; there is no result. */
  | null
  /** The document is as it was. */
  | { rev: number }
  /** An edit is previewed. */
  | { demand: Demand | null };

/**
 * Keys, offsets, masks and markers of some frames, counted from 0. Poses are written out, and each
 * key says what follows it, so that a part means the same in every clip.
 */
export interface Part {
  /** Joint names; rows follow this order. */
  joints: string[];
  /** Keys. */
  keys: Key[];
  /** Frames. */
  length: number;
  /** Markers. */
  markers?: Marker[];
  /** Mask spans. */
  masks?: Mask[];
  /** Offsets. */
  offsets?: Offset[];
}

/** Body with a path. */
export interface PathBody {
  path: string;
}

/** A summary of a clip file. */
export interface Peek {
  /** Keys. */
  keys: number;
  /** Frames. */
  length: number;
  /** Title. */
  name: string;
  /** Robot. */
  robot: string;
}

/** The phase of a rollout. */
export type Phase =
  /** There is none. */
  | "off"
  /** Asked for, no frame yet. */
  | "waiting"
  /** Frames come. */
  | "running"
  /** All frames are there. */
  | "done"
  /** It broke; frames before stand. */
  | "failed";

/** A site that inverse kinematics keeps in place, or at another site. */
export interface Pin {
  /** The place where the point stays, in the world, m. */
  pos?: [number, number, number];
  /** The orientation of the point there, w x y z; free if absent. */
  quat?: [number, number, number, number];
  /** The site. */
  site: string;
  /** Instead of both: the site that it touches. */
  to?: string;
}

/** A place in a file. */
export interface Place {
  /** Column in characters, from 1. */
  col: number;
  /** Line, from 1. */
  line: number;
}

/** A plane to draw on. */
export type Plane =
  /** The ground, z = 0. */
  | "ground"
  /** Level, through the site. */
  | "level"
  /** Through the site, facing the camera. */
  | "view";

/** A policy to choose. */
export interface PolicyCard {
  /** Whether it can be chosen for this robot without a model file given by the user. */
  available: boolean;
  /** Whether it performs if no policy is chosen. */
  default: boolean;
  /** The guide that should fill masked frames for it. */
  guide: Guide;
  /** Whether it computes with the robot's own model. */
  knows_model: boolean;
  /** Whether the policy is learned, so that another model file can be given for it. */
  learned: boolean;
  /**
   * The name of the model, unless it is the robot's default: `model_path` of
   * `RolloutSettings`.
   */
  model?: string;
  /** Name, as on the command line. */
  name: PolicyName;
  /** Whether it plans for so long that a clip takes seconds. */
  slow: boolean;
  /** The case that it is best for. */
  suits: string;
  /** The missing part that it needs, if it cannot be chosen. */
  why?: string;
}

/** All policies. */
export type PolicyName =
  /** No torque. */
  | "zero"
  /** A new random action in every frame. */
  | "random"
  /** Proportional-derivative, gains from the mass matrix. */
  | "pd"
  /** Inverse dynamics of the true model. */
  | "computed-torque"
  /** Inverse dynamics of a model whose mass, damping and motor strength are identified. */
  | "adaptive-computed-torque"
  /** Receding-horizon iLQR on the true model. */
  | "ilqr"
  /** Predictive sampling on the true model. */
  | "predictive-sampling"
  /** A trained network. */
  | "robert"
  /** The linear prediction inside a model file. */
  | "ridge"
  /** The actions of the most similar recorded moments. */
  | "nearest"
  /** A small network of three frames. */
  | "mlp-inverse"
  /** The best of several on the given clip; see `super::Contenders`. */
  | "auto";

/** Body of `POST /api/settle`. */
export interface Pose {
  q: number[];
}

/** Arguments of `pose.apply`. */
export interface PoseApply {
  /** 0 = the current values, 1 = the pose. */
  blend?: number;
  /** The frames that are changed; a frame without a key gets one. */
  frames: number[];
  /** Only these joints; absent = all. */
  joints?: string[];
  /** The pose's mirror image. */
  mirrored?: boolean;
  /** The pose's name. */
  name: string;
}

/** Arguments of `pose.delete`. */
export interface PoseDelete {
  /** Its name. */
  name: string;
}

/** A named pose of a robot. */
export interface PoseFacts {
  /** Its name. */
  name: string;
  /** One value per state joint. */
  q: number[];
}

/** Query of `GET /api/pose.jpg`. */
export interface PoseQuery {
  pose: string;
  /** Not read: see `StillQuery`. */
  v?: string;
}

/** Arguments of `pose.rename`. */
export interface PoseRename {
  /** Its name. */
  name: string;
  /** Its new name. */
  to: string;
}

/** Arguments of `pose.save`. */
export interface PoseSave {
  /** Its name. */
  name: string;
  /** Its values. */
  q: (number | null)[];
  /** Overwrite one of that name. */
  replace?: boolean;
}

/** Body of `POST /api/kinematics`. */
export interface Poses {
  q: number[][];
}

/** The figures of a rollout. Errors in rad or m. */
export interface Precision {
  /** Mean frames from the start of a hold until all joints are within 0.05 rad or m. */
  frames_late: number | null;
  /** Mean error in the last frame of each hold. */
  hold_end: number | null;
  /** Each hold: a run of three or more frames with one goal for the same joints. */
  holds: HoldError[];
  /**
   * Mean absolute error over masked frames. If the hidden motion is known (tasks extracted from
   * data, see `hidden_error`), the error is against that motion. Otherwise it is against the
   * straight line through the gap, and only shows how direct the motion was.
   */
  masked_mae: number | null;
  /** Mean |a_t - a_(t-1)| in actions: the paper's "shaking". */
  mean_abs_du: number;
  /**
   * Mean absolute error over the visible frames at which the command moves, that is, at which
   * some joint has another goal than before. The first frame of a hold counts, its other frames
   * do not.
   */
  moving: number | null;
  /** 95th percentile over unmasked frames and joints. */
  p95: number | null;
  /** Mean error by frame; null where masked. Frame 0 is the start. */
  per_frame: (number | null)[];
  /** Mean error by joint over unmasked frames. */
  per_joint: (number | null)[];
  /**
   * Mean absolute error over unmasked frames and joints: the paper's Precision. null
   * when nothing was commanded.
   */
  precision: number | null;
  /** Share of actions at their bound. */
  saturation: number;
  /** Largest frame mean, with its frame. */
  worst: [number, number] | null;
}

/** An end-effector goal: the position that a site, or a point of a body, should have in the world. */
export interface Reach {
  /** The body whose point it is. */
  body?: string;
  /** The point in the body's frame, m; its origin when absent. */
  offset?: [number, number, number];
  /** Position in the world, m. */
  pos: [number, number, number];
  /** Orientation in the world, w x y z; free when absent. */
  quat?: [number, number, number, number];
  /** The site. */
  site?: string;
}

/** One recent file. */
export interface RecentFile {
  /** Whether it is still there. */
  exists: boolean;
  /** Title of the clip. */
  name: string;
  /** When it was last opened here, seconds since 1970. */
  opened_secs: number;
  /** Path. */
  path: string;
  /** Robot. */
  robot: string;
}

/**
 * What came back when a clip was opened: its studio was killed, another program has changed its file since
 * it was closed, or its journal is damaged.
 */
export interface Restored {
  /** Edits that are not saved; what had been undone is none. */
  edits: number;
  /**
   * Whether another program has changed the file since then, so that saving would overwrite that
   * change.
   */
  file_changed: boolean;
  /** The path where the damaged journal is kept. */
  kept: string | null;
  /** Damaged parts that could not be recovered, in words. */
  lost: string[];
  /** Bytes of an unfinished record at the end that were dropped; it was never acknowledged. */
  torn_bytes: number;
}

/** The robot that a clip was made for. */
export interface Robot {
  /** Its id, such as ur5e. */
  id: string;
  /** Joint names; all rows follow this order. */
  joints: string[];
  /** Path of its model. */
  model?: string;
  /** Sha-256 of that model. */
  model_sha256?: string;
  /** Units of the joints. */
  units?: Unit[];
}

/** One robot, in short. */
export interface RobotCard {
  /** Whether it comes with the program. */
  builtin: boolean;
  /** Identifier. */
  id: string;
  /** Names of the trained models that it has. */
  models: string[];
  /** The source that it is loaded from: its id, or its folder. */
  source: string;
}

/** The facts about a robot that a page needs. */
export interface RobotFacts {
  /** A sentence or two. */
  about: string;
  /** Actuator names. */
  actuators: string[];
  /** Axes of the state joints. */
  axes: AxisFacts[];
  /** Bodies, the world first. */
  bodies: BodyFacts[];
  /** Default view. */
  camera: Camera;
  /** Fingers, limbs. */
  groups: Group[];
  /** Identifier. */
  id: string;
  /** Sites that can be dragged by inverse kinematics. */
  ik_sites: SiteFacts[];
  /** Origin and terms. */
  licence: string;
  /** Policies that can perform it. */
  offers: Offer[];
  /** Named poses, the home pose first. */
  poses: PoseFacts[];
  /** Distance above which a pose counts as not reached, rad or m. */
  settle_tolerance: number;
  /** The source that it is loaded from: its id, or its folder. */
  source: string;
  /** Joints, limits, mirror, couplings: what clips need. */
  table: JointTable;
  /** Name for people. */
  title: string;
}

/** The settings of the live rollout. */
export interface RolloutSettings {
  /** Roll out after every edit. */
  auto: boolean;
  /** Virtual commands through masks. */
  guide: Guide;
  /** Model or fit file, for learned policies. */
  model_path?: string;
  /** The policy. */
  policy: PolicyName;
  /** Improve each action on the model. */
  refine: boolean;
  /** Seed. */
  seed: number;
}

/** The progress of the rollout. */
export interface RolloutState {
  /** Frames `0..cached_to` are valid. */
  cached_to: number;
  /** Why it failed. */
  error?: string;
  /** Frames of the clip. */
  frames: number;
  /** The number of the rollout; increases with every restart. */
  gen: number;
  /** Mean absolute error so far, rad or m. */
  mae: number | null;
  /** Time a simulated frame takes, milliseconds. */
  ms_per_frame: number | null;
  /** The phase in which it is. */
  phase: Phase;
  /**
   * The policy, such as `pd+refine`. For `auto` the policy that it chose, as soon as it has
   * chosen.
   */
  policy: string;
  /** The frame it was resumed from. */
  resumed_at: number;
  /** Version of the document that it performs; 0 for a preview. */
  rev: number;
  /** How the motion is being improved, once all frames are there. */
  stage?: Stage;
  /**
   * The policies that `auto` compared, in the order in which they were tried; empty for a named
   * policy.
   */
  tried: Trial[];
}

/** `GET /api/rollout`. */
export interface RolloutView {
  /** Mean absolute error by frame, null where masked. */
  error: (number | null)[];
  /** Full figures, when done. */
  precision: Precision | null;
  /** Achieved states; `q[f]` is frame f. */
  q: number[][];
  /** State. */
  state: RolloutState;
}

/** Kinds of findings. The words are stable, so scripts may filter by them. */
export type Rule =
  /** Made for another robot, or another version of its model. */
  | "other-robot"
  /** A joint the robot does not have, or one that the clip lacks. */
  | "unknown-joint"
  /** A unit that differs from the robot's. */
  | "unit"
  /** A value outside the joint's range. */
  | "joint-limit"
  /** A joint would have to move faster than it can. */
  | "joint-speed"
  /** The policy sees no goal. */
  | "blind-span"
  /** Joints of one actuator that cannot be set apart. */
  | "coupled"
  /** Single joints are masked, but the policy was trained on whole frames. */
  | "partial-mask"
  /** Links that touch. */
  | "self-collision"
  /** A pose that the robot does not reach. */
  | "unreachable"
  /** A key that a mask hides, or a hold that is cut short. */
  | "hidden"
  /** No key at all, or a single frame. */
  | "empty";

/** A training run on disk. */
export interface RunCard {
  /** Seconds since 1970 of the last change. */
  changed_secs: number;
  /** The data of the run, once it has a model. */
  dataset_sha256: string | null;
  /** The model of the run, once it exists. */
  model: string | null;
  /** Folder, relative to the studio's. */
  path: string;
  /** Best Precision by suite, if it was measured. */
  precision: Record<string, number> | null;
  /** Preset it began with. */
  preset: string;
  /** Robot, once there is a model. */
  robot: string | null;
  /** Steps done. */
  step: number;
  /** Steps wanted. */
  steps: number;
}

/** Body of `POST /api/save`. */
export interface SaveBody {
  path?: string;
  /** Whether another file of that name is to be replaced. */
  replace?: boolean;
}

/** `POST /api/save`. */
export interface Saved {
  /** The file. */
  path: string;
  /** Version that it holds. */
  rev: number;
}

/** The selection; shared by all clients. */
export interface Selection {
  /** A body. */
  body?: string;
  /** A state joint. */
  joint?: string;
  /** A site to drag by inverse kinematics. */
  site?: string;
}

/** The pose that the robot reaches when it is driven to a pose and comes to rest. */
export interface SettleAnswer {
  /** One value per state joint. */
  q: number[];
  /** The distance from the requested pose, by joint. */
  residual: number[];
  /** Whether all are within the robot's tolerance. */
  within: boolean;
  /** The greatest, and its joint. */
  worst: number;
  /** Index of the joint that has it. */
  worst_joint: number;
}

/** The pose in which a robot comes to rest when it is driven to another one that it cannot hold. */
export interface SettledPose {
  /** The pose it was driven to, in the clip's joint order, rad or m. */
  asked: number[];
  /** How far, rad or m. */
  distance: number;
  /** The frames that command the pose: of each key `[from, to)`. */
  held: [number, number][];
  /** The joint that stays farthest off. */
  joint: string;
  /** The pose in which it rests, in the clip's joint order, rad or m. */
  q: number[];
}

/** A joint on a tendon. */
export interface Share {
  /** Its factor; not 0. */
  factor: number;
  /** Index of the joint. */
  joint: number;
}

/** The answer of `GET /api/shelf`. */
export interface Shelf {
  /** Data that is not complete yet, by path. */
  begun: BegunCard[];
  /** Data, by path. */
  data: DataCard[];
  /** Presets of training, each with a sentence. */
  presets: [string, string][];
  /** Runs, the newest first. */
  runs: RunCard[];
}

/** A point that can be pulled. */
export interface SiteFacts {
  /** Its body. */
  body: number;
  /** Its name. */
  name: string;
  /** Position in the body's frame, m. */
  pos: [number, number, number];
  /** Orientation in the body's frame, w x y z. */
  quat: [number, number, number, number];
}

/** A named point of a body. */
export interface SiteFrame {
  /** Index of its body. */
  link: number;
  /** Its name. */
  name: string;
  /** Position in the body's frame, m. */
  pos: [number, number, number];
  /** Orientation in the body's frame, w x y z. */
  quat: [number, number, number, number];
}

/** A run of frames of one kind: `[from, to)`. The spans of a command tile the clip. */
export interface Span {
  /** First frame. */
  from: number;
  /** Its kind. */
  kind: SpanKind;
  /** Frame after the last. */
  to: number;
}

/**
 * The origin of the values of a run of frames: of those of a key that is held, otherwise of the joint with the
 * strongest fill.
 */
export type SpanKind =
  /** A key and its hold. */
  | "key"
  /** A straight line between keys. */
  | "linear"
  /** A cubic between keys. */
  | "cubic"
  /** A key's value kept to the joint's next key. */
  | "hold"
  /** No goal, because nothing fills it. */
  | "open"
  /** No goal (for all joints), because a mask span hides it. */
  | "masked";

/** How the motion of a policy is improved, one stage after another. */
export type Stage =
  /** Passes with goals that are moved by what was missed. */
  | "correct"
  /** A planner performs the clip. Its frames take several times as long as those of a policy. */
  | "plan"
  /** Passes along the planner's path. */
  | "follow"
  /** Tries of the random search. */
  | "search"
  /** Tries of softer motion in gaps. */
  | "soften";

/** Exactly one of a named pose and values. */
export interface Start {
  /** A named pose of this clip. */
  pose?: string;
  /** One value per joint. */
  q?: number[];
}

/** Everything a fresh page needs. */
export interface State {
  /** Editor clients connected. */
  clients: number;
  /** The document, if one is open. */
  document: DocumentView | null;
  /** The folder where relative paths start. */
  folder: string;
  /** Joints that are locked: no drag moves them. */
  locked: string[];
  /** Sites that inverse kinematics keeps in place. */
  pins: Pin[];
  /** Policies that can be chosen. */
  policies: PolicyCard[];
  /** Rollout settings. */
  rollout: RolloutSettings;
  /** Takes of the open robot. */
  takes: TakesView;
  /** Version of the program. */
  version: string;
  /** Whether the 3D client is available; if not, the viewport shows stills. */
  viser: boolean;
  /** The simulation. */
  worker: WorkerState;
}

/** Query of `GET /api/still-body`. */
export interface StillBodyQuery {
  frame: number;
  h: number;
  w: number;
  /** From the left edge, 0 to 1. */
  x: number;
  /** From the top edge, 0 to 1. */
  y: number;
}

/** Query of `GET /api/still.jpg`. */
export interface StillQuery {
  achieved?: boolean;
  command?: boolean;
  draft?: boolean;
  frame?: number;
  ghosts?: boolean;
  h?: number;
  /** Numbers separated by commas: a pose that is shown instead of the reached one. */
  pose?: string;
  /**
   * Not read. It changes the address when the picture has changed, so that the browser fetches
   * it again.
   */
  v?: string;
  w?: number;
}

/** Requests on the socket that are not clip edits. */
export type StudioOp =
  /** Takes the last edit back. */
  | { op: "undo"; args: Record<string, never> }
  /** Does it again. */
  | { op: "redo"; args: Record<string, never> }
  /** Undoes or redoes until `done` edits are done. */
  | { op: "history.goto"; args: { done: number } }
  /**
   * Previews an edit: it is rolled out, but not stored. Send it during a drag; the newest one
   * replaces the others. The reply's `demand` is the `robert_clip::Demand` of the edit, or
   * null.
   */
  | { op: "preview"; args: { op: Op } }
  /** Back to the document. */
  | { op: "preview.end"; args: Record<string, never> }
  /** Changes how rollouts are made; absent fields get their defaults. */
  | { op: "rollout.set"; args: RolloutSettings }
  /** Rolls out now (when `auto` is off). */
  | { op: "rollout.run"; args: Record<string, never> }
  /** Stops it; frames so far stay. */
  | { op: "rollout.cancel"; args: Record<string, never> }
  /** Starts the simulation again after it has failed too often. */
  | { op: "worker.restart"; args: Record<string, never> }
  /** Pins a take, which is then kept until it is removed, or unpins it. */
  | { op: "take.pin"; args: { id: number; pinned: boolean } }
  /** Names a take and pins it. */
  | { op: "take.name"; args: { id: number; name: string } }
  /** Draws these takes beside the current motion; the last one also in the viewport. */
  | { op: "take.compare"; args: { ids: number[] } }
  /** Forgets a take. */
  | { op: "take.remove"; args: { id: number } }
  /** Shows this frame in the viewport (also while scrubbing). */
  | { op: "view.frame"; args: { frame: number } }
  /**
   * Plays in the viewport, at `speed` from `frame` on; the page runs its own clock in the same
   * way.
   */
  | { op: "view.play"; args: { frame: number; range?: [number, number]; speed: number } }
  /** The parts that the viewport shows; absent fields keep their value. */
  | { op: "view.show"; args: ViewShow }
  /** Selects a joint or a body, or nothing. */
  | { op: "view.select"; args: Selection }
  /** Joints that stay fixed in the viewport, in drags and in inverse kinematics. */
  | { op: "view.lock"; args: { joints: string[] } }
  /** Sites that inverse kinematics keeps in place, in every request. */
  | { op: "view.pins"; args: { pins: Pin[] } }
  /** Cancels the current drag in the viewport. */
  | { op: "view.cancel"; args: Record<string, never> }
  /** Frames the camera: `home`, `fit`, `front`, `side`, `top`, `selection`. */
  | { op: "view.camera"; args: { preset: string } }
  /** Shows a pose that is not in the clip (a floating pose); null ends it. */
  | { op: "view.pose"; args: { q?: number[] | null } };

/** A take, in short. */
export interface TakeCard {
  /** Title of its clip. */
  clip: string;
  /** Frames. */
  frames: number;
  /** Number, for `GET /api/takes/{id}` and the operations on it. */
  id: number;
  /**
   * Roughness: root mean square of the motion's third differences over all joints, rad/s³ or
   * m/s³. Smoother is lower.
   */
  jerk: number | null;
  /** Mean absolute error over all goals, rad or m. */
  mae: number | null;
  /** The name of the policy. */
  name: string;
  /** Kept until it is removed. */
  pinned: boolean;
  /** Policy as tables show it. */
  policy: string;
  /** The version of the document that it performs, as long as that document is open. */
  rev: number;
  /** Whether its goals equal those of the current command, so that the errors can be compared. */
  same_goals: boolean;
  /** Seed of the policy's draws. */
  seed: number;
  /** That error, rad or m. */
  worst: number | null;
  /** The joint with the largest mean absolute error over its goals. */
  worst_joint: string | null;
}

/** The motion of a take. */
export interface TakeFrames {
  /** Mean absolute error by frame, null where masked. */
  error: (number | null)[];
  /** Achieved states by frame; (frames, S). */
  q: number[][];
}

/** All that a client draws of takes. */
export interface TakesView {
  /** The takes drawn beside the current motion, in this order; the last one also in the viewport. */
  compared: number[];
  /** Sentences about pinned takes on disk that could not be read when the studio began. */
  skipped: string[];
  /** Takes of the open robot, the newest first. */
  takes: TakeCard[];
}

/** The slope of one joint at one key. A joint without a tangent has the automatic slope. */
export type Tangent =
  /** A slope by its name. */
  | TangentName
  /** The same slope before and after the key, rad/s or m/s. */
  | number
  /** Two slopes, so that the curve has a corner at the key. */
  | Corner;

/** A slope that needs no number. */
export type TangentName =
  /** Slope 0: the joint rests for a moment. */
  | "flat"
  /** On each side the slope of the straight line to the neighbouring key. */
  | "linear";

/** Arguments of `tangent.set`. */
export interface TangentSet {
  /** At which keys. */
  frames: number[];
  /** Of which joints; absent = all. */
  joints?: string[];
  /** The slope; null = automatic. */
  tangent?: Tangent | null;
}

/** Query of `GET /api/thumbnail.jpg`: either `path` or `take`. */
export interface ThumbnailQuery {
  /** A clip's file. */
  path?: string;
  /** A take of the open robot. */
  take?: number;
}

/** Arguments of `time.delete`. */
export interface TimeDelete {
  /** First frame. */
  from: number;
  /** Frame after the last. */
  to: number;
}

/** Arguments of `time.insert`. */
export interface TimeInsert {
  /** The frame before which frames are inserted; the clip's length appends. */
  at: number;
  /** The number of frames. */
  frames: number;
}

/** The result of one contender. */
export interface Trial {
  /** Why it failed. */
  error?: string;
  /**
   * Penalty of its motion, rad or m: for overshoot, long paths and jerk in gaps, for a missed frame and
   * for motion within holds. 0 if the motion is within the limits.
   */
  gaps: number;
  /**
   * What decides beside the penalty, rad or m: the error with dropouts if there are any, else Precision, and
   * that of joints that one actuator moves together.
   */
  judged?: number;
  /** The policy, as in `PolicyConfig::label`. */
  policy: string;
  /** Its Precision, rad or m; null when it failed, or when nothing was commanded. */
  precision: number | null;
  /** In clips with dropouts, the mean error over goals and the likely motion in dropouts, rad or m. */
  with_dropouts?: number;
}

/** The unit of one joint coordinate. */
export type Unit =
  /** Hinge joints. */
  | "rad"
  /** Slide joints, metres. */
  | "m";

/** Query of `PUT /api/upload`. */
export interface UploadQuery {
  first?: boolean;
  path: string;
}

/** Parts of the viewport. */
export interface ViewShow {
  /** The achieved motion, solid. */
  achieved?: boolean;
  /** The command, translucent. */
  command?: boolean;
  /** Dark background. */
  dark?: boolean;
  /** Poses of the neighbouring keys. */
  ghosts?: boolean;
  /** The path of what is selected. */
  path?: boolean;
  /** The pose that the robot can reach at the playhead, where it cannot reach the commanded one. */
  reachable?: boolean;
  /** Whether the robot casts a shadow on the ground. */
  shadows?: boolean;
}

/** Phases of the worker. */
export type WorkerPhase =
  /** Not started yet, or not needed at the moment. */
  | "starting"
  /** Up. */
  | "ready"
  /** It died; a new one comes. */
  | "restarting"
  /** The worker died too often; it starts again only on request. */
  | "stopped";

/** The simulation as a banner shows it. */
export interface WorkerState {
  /** Times that it died in this run. */
  deaths: number;
  /** `starting`, `ready`, `restarting`, `stopped`. */
  phase: WorkerPhase;
  /** Its process. */
  pid: number | null;
  /** Why it died last. */
  reason: string | null;
}

/** Requests over HTTP: what each takes and what comes back. */
export interface Routes {
  "POST /api/session": { answer: void };
  "GET /api/state": { answer: State };
  "GET /api/clip": { answer: Clip };
  "PUT /api/clip": { body: string | Blob; answer: Edited };
  "POST /api/ops": { body: OpsRequest; answer: Edited };
  "POST /api/undo": { answer: Edited };
  "POST /api/redo": { answer: Edited };
  "POST /api/discard": { answer: Edited };
  "POST /api/reload": { answer: Edited };
  "POST /api/open": { body: PathBody; answer: DocumentView };
  "POST /api/new": { body: NewBody; answer: DocumentView };
  "POST /api/save": { body: SaveBody; answer: Saved };
  "POST /api/close": { answer: void };
  "GET /api/thumbnail.jpg": { query: ThumbnailQuery; answer: void };
  "GET /api/formats": { answer: ExportFormat[] };
  "GET /api/files": { query: FilesQuery; answer: Listing };
  "POST /api/clips": { query: ClipQuery; body: string | Blob; answer: DocumentView };
  "POST /api/insert": { query: InsertQuery; body: string | Blob; answer: Edited };
  "GET /api/gallery": { answer: GalleryItem[] };
  "POST /api/gallery/{id}": { answer: DocumentView };
  "GET /api/recent": { answer: RecentFile[] };
  "GET /api/drafts": { answer: Draft[] };
  "POST /api/drafts/{number}": { answer: DocumentView };
  "POST /api/drafts/{number}/discard": { answer: void };
  "GET /api/robots": { answer: RobotCard[] };
  "GET /api/robot/{id}": { answer: RobotFacts };
  "GET /api/robot/{id}/geometry": { answer: Geometry };
  "POST /api/kinematics": { body: Poses; answer: number[][] };
  "POST /api/ik": { body: IkRequest; answer: IkAnswer };
  "POST /api/draw": { body: DrawRequest; answer: DrawAnswer };
  "POST /api/settle": { body: Pose; answer: SettleAnswer };
  "GET /api/rollout": { answer: RolloutView };
  "GET /api/takes": { answer: TakesView };
  "GET /api/takes/{id}": { answer: TakeFrames };
  "GET /api/export": { query: ExportQuery; answer: Blob };
  "POST /api/exports": { body: ExportRequest; answer: JobView };
  "GET /api/shelf": { answer: Shelf };
  "GET /api/curves": { query: PathBody; answer: Record<string, Json>[] };
  "PUT /api/upload": { query: UploadQuery; body: string | Blob; answer: void };
  "POST /api/import": { body: ImportBody; answer: JobView };
  "GET /api/jobs": { answer: JobView[] };
  "POST /api/jobs": { body: JobRequest; answer: JobView };
  "GET /api/jobs/{id}": { query: LinesFrom; answer: JobView };
  "GET /api/jobs/{id}/file": { answer: Blob };
  "POST /api/jobs/{id}/cancel": { answer: JobView };
  "POST /api/jobs/{id}/resume": { answer: JobView };
  "GET /api/still.jpg": { query: StillQuery; answer: Blob };
  "GET /api/hover": { query: HoverQuery; answer: Hovered | null };
  "GET /api/still-body": { query: StillBodyQuery; answer: string | null };
  "GET /api/pose.jpg": { query: PoseQuery; answer: Blob };
  "GET /api/gallery-picture.jpg": { query: ExampleQuery; answer: Blob };
  "GET /api/gallery-error": { query: ExampleQuery; answer: MeanError | null };
}

/** What the page sends on the socket, beside an `id`. */
export type Request = Op | StudioOp;

/** The arguments of the operation of this name. */
export type Args<Name extends Request["op"]> = Extract<Request, { op: Name }>["args"];
