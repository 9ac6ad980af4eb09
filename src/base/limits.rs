//! The limits of files and messages from outside, and of what the studio keeps. Foreign files are
//! treated as hostile until they are checked. The test of each limit is named in
//! `docs/reliability.md`.

/// Bytes in one clip file.
pub const CLIP_BYTES: u64 = 16 << 20;
/// Frames in a clip.
pub const CLIP_FRAMES: u32 = 100_000;
/// Keyframes in a clip.
pub const CLIP_KEYS: usize = 50_000;
/// Joints in a clip or robot.
pub const JOINTS: usize = 256;
/// Length of a name, bytes.
pub const NAME_BYTES: usize = 256;
/// Nesting of JSON documents.
pub const JSON_DEPTH: usize = 64;
/// Values in all keys and poses of a clip, and frames times joints of its command. This bounds the
/// memory of a hostile clip (50 000 keys of 256 joints would take 200 MB).
pub const CLIP_VALUES: usize = 4 << 20;
/// Largest joint value in a clip, rad or m: far beyond any robot, far inside `f32`.
pub const CLIP_VALUE_MAX: f64 = 1e6;
/// Named poses in a clip.
pub const CLIP_POSES: usize = 10_000;
/// Mask spans in a clip, and markers.
pub const CLIP_SPANS: usize = 50_000;
/// Tangents in all keys of a clip.
pub const CLIP_TANGENTS: usize = 1 << 18;
/// Values in all offsets of a clip.
pub const CLIP_OFFSETS: usize = 1 << 18;
/// End-effector goals in all keys of a clip.
pub const CLIP_REACHES: usize = 4096;
/// Frames of a clip at which inverse kinematics is solved.
pub const CLIP_REACH_FRAMES: usize = 10_000;
/// Joint names in all mask spans of a clip.
pub const CLIP_MASK_JOINTS: usize = 1 << 18;
/// Values under the extension key `x` of a clip.
pub const CLIP_EXTRA_VALUES: usize = 100_000;
/// Length of the notes of a clip, bytes.
pub const NOTES_BYTES: usize = 64 << 10;
/// Edits in one batch.
pub const BATCH_OPS: usize = 10_000;

/// Bytes in one MJCF or URDF file.
pub const MODEL_BYTES: u64 = 8 << 20;
/// Nesting of XML elements.
pub const XML_DEPTH: usize = 64;
/// XML elements in one file, including its includes.
pub const XML_ELEMENTS: usize = 200_000;
/// XML elements of a foreign model, with its includes. The time of the compiler grows with the square
/// of many of them: 19,000 geoms took 6 s and 150,000 keyframes a minute. The largest of 390 public
/// robots has 3,900 elements.
pub const MODEL_ELEMENTS: usize = 8_000;
/// Pairs of geoms of a model that may collide; the cost of a step grows with those that overlap.
pub const MODEL_PAIRS: usize = 1_000_000;
/// Attributes of one XML element. The MJCF element with the most has about sixty.
pub const XML_ATTRIBUTES: usize = 256;
/// Namespace declarations in one XML file.
pub const XML_NAMESPACES: usize = 64;
/// Nesting of `<include>`.
pub const INCLUDE_DEPTH: usize = 8;
/// Models that a model attaches, with what they attach themselves.
pub const ATTACHED_MODELS: usize = 100;
/// Faces in one mesh.
pub const MESH_FACES: usize = 2_000_000;
/// Bytes in one mesh file.
pub const MESH_BYTES: u64 = 256 << 20;
/// Bytes of one COLLADA file.
pub const DAE_BYTES: u64 = 64 << 20;
/// XML elements of one COLLADA file.
pub const DAE_ELEMENTS: usize = 500_000;
/// Nodes of a COLLADA scene; those of repeated instances count each time.
pub const DAE_NODES: usize = 100_000;
/// Nesting of the nodes of a COLLADA scene.
pub const DAE_DEPTH: usize = 64;
/// Pixels along one edge of a texture.
pub const TEXTURE_PX: u64 = 4096;
/// Bytes of all textures of a model, unpacked. One cube of 2,048 pixels takes 75 MB.
pub const TEXTURE_BYTES: u64 = 256 << 20;
/// Simulator steps in which the compiler measures the length ranges of all actuators.
pub const LENGTH_RANGE_STEPS: f64 = 500_000.0;
/// Elements of one `<composite>`.
pub const COMPOSITE_ELEMENTS: usize = 2_000;
/// Generalised coordinates of a model.
pub const MODEL_NQ: usize = 1024;
/// Address space of the child that compiles a foreign model, bytes.
pub const CHECK_MEMORY_BYTES: u64 = 4 << 30;
/// Processor time of that child, seconds.
pub const CHECK_CPU_SECS: u64 = 20;
/// Bytes of a file that a child or an import may write.
pub const CHILD_FILE_BYTES: u64 = 1 << 30;
/// Time that child may take by the clock, seconds.
pub const CHECK_WALL_SECS: u64 = 60;

/// Bytes of a project folder handed to an importer.
pub const PROJECT_BYTES: u64 = 64 << 20;
/// Bytes of one upload to the studio.
pub const UPLOAD_BYTES: u64 = 256 << 20;
/// Files in one project or upload.
pub const PROJECT_FILES: usize = 1_000;
/// Bytes of one inbound WebSocket message.
pub const WS_MESSAGE_BYTES: usize = 1 << 20;
/// Bytes of one WebSocket frame (a message may have several).
pub const WS_FRAME_BYTES: usize = 256 << 10;
/// Unsent bytes of one WebSocket above which its client is disconnected.
pub const WS_WRITE_BYTES: usize = 4 << 20;
/// Studio clients at once, on each of the two sockets.
pub const CLIENTS: usize = 16;
/// Open connections of the studio.
pub const CONNECTIONS: usize = 512;
/// Bytes of a request's head.
pub const HEAD_BYTES: usize = 16 << 10;
/// Time for a request's head, seconds.
pub const HEAD_SECS: u64 = 5;
/// Time for a request's body and answer, seconds.
pub const BODY_SECS: u64 = 30;
/// Bytes of a JSON request other than a clip.
pub const REQUEST_BYTES: usize = 2 << 20;
/// Bytes of a journal that is read back.
pub const JOURNAL_BYTES: u64 = 1 << 30;
/// Bytes of one record of a journal.
pub const JOURNAL_RECORD_BYTES: usize = 64 << 20;
/// Bytes of one message between the studio and its worker.
pub const WORKER_MESSAGE_BYTES: usize = 256 << 20;
/// Address space of the worker, bytes.
pub const WORKER_MEMORY_BYTES: u64 = 8 << 30;
/// Processor time that the worker may spend on one request, seconds.
pub const WORKER_CPU_SECS: u64 = 120;
/// Pixels along an edge of a picture that the studio shows.
pub const STILL_PX: u32 = 2560;
/// Recent files kept.
pub const RECENT: usize = 20;
/// Takes kept in the studio, all robots together.
pub const TAKES: usize = 20;
/// Bytes of the motions of all takes.
pub const TAKES_BYTES: usize = 96 << 20;
/// Bytes of the motions of pinned takes; the rest is left to the current ones.
pub const TAKES_PINNED_BYTES: usize = TAKES_BYTES / 2;
/// Takes drawn beside the current rollout.
pub const TAKES_COMPARED: usize = 4;
/// Sites that inverse kinematics holds in the studio.
pub const PINS: usize = 16;
/// Points of a drawn line.
pub const DRAWN_POINTS: usize = 4_000;
/// Entries of one folder that the studio lists.
pub const FOLDER_ENTRIES: usize = 1_000;
/// Entries of one folder that are examined.
pub const FOLDER_LOOKED_AT: usize = 20_000;
/// Bytes of clips that are read for one list.
pub const FOLDER_PEEK_BYTES: u64 = 8 << 20;
/// Jobs kept in the studio's list.
pub const JOBS: usize = 64;
/// Lines kept of one job.
pub const JOB_LINES: usize = 2_000;

/// Bytes of a file with settings: a profile, a sweep, a spec of shards; and of a result of a sweep.
pub const SETTINGS_BYTES: u64 = 4 << 20;
/// Bytes of a table: the metrics of a run, and whatever else is plotted.
pub const TABLE_BYTES: u64 = 256 << 20;
/// Bytes of what a run says about itself.
pub const RUN_BYTES: u64 = 1 << 20;
/// Bytes of a plan of shards.
pub const PLAN_BYTES: u64 = 256 << 20;
/// Bytes of a list of the shards of all tasks of a plan.
pub const TASK_LIST_BYTES: u64 = 64 << 20;
/// Bytes of the manifest of a shard of a plan.
pub const PLAN_SHARD_BYTES: u64 = 16 << 20;
/// Bytes of one data file of a LeRobot dataset: the format's own limit and a reserve.
pub const DATASET_FILE_BYTES: u64 = 256 << 20;
/// Rows of one file of a LeRobot dataset. A few bytes can claim any number of them.
pub const DATASET_ROWS: i64 = 1_000_000;
/// Values of one column in one file of a LeRobot dataset. Its own limit of 100 MB is reached before.
pub const DATASET_VALUES: i64 = 1 << 24;
/// Bytes of one page of a Parquet file, unpacked. Writers aim at one megabyte.
pub const DATASET_PAGE_BYTES: u64 = 32 << 20;
/// Pages that are read of one Parquet file.
pub const DATASET_PAGES: usize = 100_000;
/// Bytes in the footer of a Parquet file.
pub const DATASET_FOOTER_BYTES: u64 = 16 << 20;
/// Elements of all lists in that footer. A tenth of them may be columns, row groups and the like.
pub const DATASET_FOOTER_ELEMENTS: u64 = 1_000_000;
/// Bytes in the header of a safetensors file.
pub const TENSOR_HEADER_BYTES: u64 = 100 << 20;
/// Bytes of a dataset manifest.
pub const MANIFEST_BYTES: u64 = 1 << 30;
/// Bytes of one dataset shard.
pub const SHARD_BYTES: u64 = 8 << 30;
/// Shards of one dataset.
pub const SHARDS: usize = 100_000;
/// Trajectories of one dataset.
pub const EPISODES: usize = 20_000_000;
/// Bytes of one model file, optimiser state included.
pub const TENSOR_FILE_BYTES: u64 = 4 << 30;
/// Bytes of one record of an MCAP file read back.
pub const MCAP_RECORD_BYTES: usize = 64 << 20;
/// Bytes of a take that is read back.
pub const TAKE_BYTES: u64 = 256 << 20;
/// Bytes of all chunks of a take, unpacked.
pub const TAKE_UNPACKED_BYTES: u64 = 512 << 20;
/// Bytes of one message of a take: enough for thousands of bodies.
pub const TAKE_MESSAGE_BYTES: usize = 1 << 20;
/// Bodies of a robot in a take.
pub const BODIES: usize = 1024;
/// Pixels along one edge of a picture.
pub const PICTURE_PX: u32 = 8192;
