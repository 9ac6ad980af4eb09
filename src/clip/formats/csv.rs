//! CSV: `frame,time,mask,<joint>...`, one row per frame, empty cell = masked.
//!
//! Any of the three leading columns may be missing when a file is read. Without `frame`, time
//! counts from the first row, and rows between frames of the 20 Hz grid are interpolated linearly
//! (a log at 100 Hz keeps its motion instead of being reduced to the nearest rows). Spreadsheets of
//! many countries write semicolons between cells and a comma in numbers; both are read, and so are
//! tabs.

use std::fmt::Display;

use super::super::command::{Command, Sight};
use super::super::document::{Clip, Fill, RobotRef, Row};
use super::super::error::ClipError;
use super::super::json::show;
use super::super::parse::utf8;
use super::samples::resample;
use super::{Track, frame_of, places, start_differs};
use robert_base::limits;
use robert_base::units::FPS;

/// A command as CSV. A row with frame -1 holds the start if it differs from the first goal.
pub fn to_csv(command: &Command) -> String {
    let goals = |t: u32| {
        let row = command.row(t).iter().enumerate();
        row.map(move |(j, v)| command.sees(t, j).then_some(*v)).collect::<Vec<_>>()
    };
    let start = start_differs(command)
        .then(|| (-1, true, command.start().iter().copied().map(Some).collect()));
    let frames =
        (0..command.frames()).map(|t| (i64::from(t), command.sight(t) == Sight::Masked, goals(t)));
    motion_to_csv(command.joints(), start.into_iter().chain(frames))
}

/// Motion as CSV. A row is a frame, whether it is masked, and the values; `None` is an empty cell.
pub fn motion_to_csv<R, V>(
    joints: &[String],
    rows: impl IntoIterator<Item = (i64, bool, R)>,
) -> String
where
    R: IntoIterator<Item = Option<V>>,
    V: Display,
{
    let lead = ["frame", "time", "mask"].map(str::to_owned);
    let mut writer = ::csv::WriterBuilder::new().flexible(true).from_writer(Vec::new());
    let mut written = writer.write_record(lead.iter().chain(joints));
    for (frame, masked, values) in rows {
        let secs = frame as f64 / f64::from(FPS);
        let lead = [frame.to_string(), secs.to_string(), u8::from(masked).to_string()];
        let cell = |v: Option<V>| v.map_or_else(String::new, |v| v.to_string());
        written = written.and_then(|()| {
            writer.write_record(lead.into_iter().chain(values.into_iter().map(cell)))
        });
    }
    let bytes = match (written, writer.into_inner()) {
        (Ok(()), Ok(bytes)) => bytes,
        (written, _) => panic!("CSV in memory cannot fail: {written:?}"),
    };
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The character between cells: that of the header, which names at least one joint.
fn delimiter(text: &str) -> u8 {
    let lines = text.lines().filter(|l| !l.trim().is_empty() && !l.starts_with('#'));
    // Names in quotes may contain any of them.
    let header: String = lines.take(1).flat_map(|l| l.split('"').step_by(2)).collect();
    match () {
        () if header.contains(',') => b',',
        () if header.contains(';') => b';',
        () if header.contains('\t') => b'\t',
        () => b',',
    }
}

struct Head {
    frame: Option<usize>,
    time: Option<usize>,
    mask: Option<usize>,
    /// Column and joint.
    joints: Vec<(usize, usize)>,
}

/// Reads a CSV. Without a robot the columns are its joints.
///
/// # Errors
/// [`ClipError::Syntax`] with line and column (counted in cells).
pub fn from_csv(bytes: &[u8], robot: Option<&RobotRef>, fill: Fill) -> Result<Clip, ClipError> {
    let text = utf8(bytes.to_vec())?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let delimiter = delimiter(text);
    // A file with points has no decimal commas: 1,234 would be a thousand times too small.
    let decimal_comma = delimiter != b',' && !text.lines().skip(1).any(|line| line.contains('.'));
    let mut reader = ::csv::ReaderBuilder::new()
        .delimiter(delimiter)
        .trim(::csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let names = reader.headers().map_err(|e| broken(&e))?.clone();
    let (head, robot) = head(&names, robot)?;
    let dim = robot.joints.len();
    let mut samples: Vec<(f64, Row)> = Vec::new();
    let mut track = Track::default();
    let mut values = 0;
    for record in reader.records() {
        let record = record.map_err(|e| broken(&e))?;
        let line = record.position().map_or(1, |p| p.line() as usize);
        values += dim;
        if values > limits::CLIP_VALUES {
            let cap = limits::CLIP_VALUES;
            return Err(ClipError::at(format!("more than {cap} values"), line, 1));
        }
        let number = |column: usize| number(&record, line, column, decimal_comma);
        let mut row: Row = vec![None; dim];
        let hidden = match head.mask {
            Some(column) => flag(&record, line, column)?,
            None => false,
        };
        for &(column, joint) in &head.joints {
            if let Some(slot) = row.get_mut(joint) {
                *slot = number(column)?;
            }
        }
        if let Some(column) = head.frame {
            let at = number(column)?;
            if at == Some(-1.0) {
                if row.contains(&None) {
                    let message = "the start (frame -1) needs a value for every joint";
                    return Err(ClipError::at(message, line, column + 1));
                }
                if track.start.replace(row).is_some() {
                    let message = "there are two rows for the start (frame -1)";
                    return Err(ClipError::at(message, line, column + 1));
                }
                continue;
            }
            let frame = at.filter(|f| f.fract() == 0.0).and_then(|f| frame_of(f / f64::from(FPS)));
            let Some(frame) = frame else {
                let last = limits::CLIP_FRAMES - 1;
                let why = format!("a frame must be a whole number from 0 to {last}");
                return Err(ClipError::at(why, line, column + 1));
            };
            if hidden {
                row.fill(None);
            }
            track.length = track.length.max(frame + 1);
            if track.rows.insert(frame, row).is_some() {
                let message = format!("there are two rows for frame {frame}");
                return Err(ClipError::at(message, line, column + 1));
            }
            continue;
        }
        let secs = match head.time {
            None => samples.len() as f64 / f64::from(FPS),
            Some(column) => match number(column)? {
                Some(t) => t,
                None => return Err(ClipError::at("this row has no time", line, column + 1)),
            },
        };
        if samples.last().is_some_and(|s| s.0 >= secs) {
            let column = head.time.unwrap_or(0) + 1;
            return Err(ClipError::at("times must increase from row to row", line, column));
        }
        if hidden {
            row.fill(None);
        }
        samples.push((secs, row));
    }
    if head.frame.is_none() {
        resample(&samples, &mut track)?;
    }
    if track.length == 0 {
        return Err(ClipError::at("there are no rows below the header", 1, 1));
    }
    track.clip(robot, fill)
}

fn head(
    names: &::csv::StringRecord,
    robot: Option<&RobotRef>,
) -> Result<(Head, RobotRef), ClipError> {
    let mut head = Head { frame: None, time: None, mask: None, joints: Vec::new() };
    let mut joints = Vec::new();
    let mut columns = Vec::new();
    for (i, name) in names.iter().enumerate() {
        // A joint may be called "time": the first such column is the time, the next the joint.
        let is_joint = || robot.is_some_and(|r| r.joints.iter().any(|j| j == name));
        let slot = match name {
            "frame" => Some(&mut head.frame),
            "time" => Some(&mut head.time),
            "time_s" | "t" if !is_joint() => Some(&mut head.time),
            "mask" => Some(&mut head.mask),
            _ => None,
        };
        match slot {
            Some(slot) if slot.is_none() => {
                *slot = Some(i);
                continue;
            }
            Some(_) if !is_joint() => {
                return Err(ClipError::at(format!("column \"{name}\" appears twice"), 1, i + 1));
            }
            _ => {}
        }
        if joints.len() >= limits::JOINTS {
            let message = format!("more than {} joint columns", limits::JOINTS);
            return Err(ClipError::at(message, 1, i + 1));
        }
        joints.push(name.to_owned());
        columns.push(i);
    }
    if joints.is_empty() {
        return Err(ClipError::at("the header names no joint", 1, 1));
    }
    let robot = robot.cloned().unwrap_or_else(|| RobotRef {
        id: "unknown".to_owned(),
        joints: joints.clone(),
        ..RobotRef::default()
    });
    let order = places(&joints, &robot, |i| (1, columns.get(i).map_or(1, |c| c + 1)))?;
    head.joints = columns.into_iter().zip(order).collect();
    Ok((head, robot))
}

fn number(
    record: &::csv::StringRecord,
    line: usize,
    column: usize,
    decimal_comma: bool,
) -> Result<Option<f64>, ClipError> {
    let cell = record.get(column).unwrap_or_default();
    if cell.is_empty() {
        return Ok(None);
    }
    let pointed = decimal_comma.then(|| cell.replacen(',', ".", 1));
    match pointed.as_deref().unwrap_or(cell).parse::<f64>() {
        Ok(v) if v.abs() <= limits::CLIP_VALUE_MAX.max(1e12) => Ok(Some(v)),
        _ => Err(ClipError::at(format!("\"{}\" is not a number", show(cell)), line, column + 1)),
    }
}

fn flag(record: &::csv::StringRecord, line: usize, column: usize) -> Result<bool, ClipError> {
    match record.get(column).unwrap_or_default() {
        "" | "0" | "false" => Ok(false),
        "1" | "true" => Ok(true),
        other => {
            let message = format!("a mask must be 0 or 1, not \"{}\"", show(other));
            Err(ClipError::at(message, line, column + 1))
        }
    }
}

fn broken(e: &::csv::Error) -> ClipError {
    let line = e.position().map_or(1, |p| p.line() as usize);
    let message = match e.kind() {
        ::csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} cells, but the header has {expected_len}")
        }
        _ => "this is not CSV".to_owned(),
    };
    ClipError::at(message, line, 1)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::super::super::compile;
    use super::*;

    #[test]
    fn spreadsheets_with_semicolons_and_tabs_are_read() {
        let plain = from_csv(b"frame,a,b\n0,0.5,1\n20,-1.25,\n", None, Fill::Mask).unwrap();
        for text in
            ["frame;a;b\r\n0;0,5;1\r\n20;-1,25;\r\n", "frame\ta\tb\n0\t0.5\t1\n20\t-1.25\t\n"]
        {
            assert_eq!(from_csv(text.as_bytes(), None, Fill::Mask).unwrap(), plain, "{text}");
        }
        for text in ["frame;a\n0;1,2,3\n", "frame\ta\tb\n0\t1,234\t0.5\n"] {
            let e = from_csv(text.as_bytes(), None, Fill::Mask).unwrap_err().to_string();
            assert!(e.contains("is not a number"), "{e}");
        }
        let named = from_csv(b"frame;\"x, left\"\n0;1\n", None, Fill::Mask).unwrap();
        assert_eq!(named.robot.joints, ["x, left"]);
    }

    #[test]
    fn names_of_joints_keep_their_commas_and_quotes() {
        let joints = ["x, left", "the \"wrist\"", "=1+1"].map(str::to_owned);
        let rows = [(0, false, [Some(0.5), None, Some(2.0)]), (1, true, [None; 3])];
        let text = motion_to_csv(&joints, rows);
        assert_eq!(
            text,
            "frame,time,mask,\"x, left\",\"the \"\"wrist\"\"\",=1+1\n0,0,0,0.5,,2\n1,0.05,1,,,\n"
        );
        let back = from_csv(text.as_bytes(), None, Fill::Mask).unwrap();
        assert_eq!(back.robot.joints, joints);
    }

    #[test]
    fn plain_logs_are_resampled() {
        let mut text = String::from("time,a,b\n");
        for i in 0..=200 {
            let t = f64::from(i) * 0.01;
            writeln!(text, "{},{},{}", 1_700_000_000.0 + t, t * 2.0, -t).unwrap();
        }
        let clip = from_csv(text.as_bytes(), None, Fill::Mask).unwrap();
        assert_eq!(clip.length, 41);
        let c = compile(&clip).unwrap();
        for t in 0..41 {
            assert!((f64::from(c.row(t)[0]) - f64::from(t) * 0.1).abs() < 1e-5);
        }
    }

    #[test]
    fn places_of_faults() {
        let at = |text: &str| from_csv(text.as_bytes(), None, Fill::Mask).unwrap_err().to_string();
        assert!(at("frame,a\n0,1\n1,x\n").starts_with("3:2: "), "{}", at("frame,a\n0,1\n1,x\n"));
        assert!(at("frame,a\n0,1\n0,1\n").starts_with("3:1: "));
        assert!(at("frame,a\n0,1,2\n").starts_with("2:1: "));
        assert!(at("frame,a\n0.5,1\n").starts_with("2:1: "));
        assert!(at("frame,frame,a\n").starts_with("1:2: "));
        assert!(at("time,a\n0,1\n0,2\n").starts_with("3:1: "));
        assert!(at("frame,a,mask\n0,1,2\n").starts_with("2:3: "));
        assert!(at("frame,a\n0,inf\n").starts_with("2:2: "));
        assert!(at("frame,a\n").starts_with("1:1: "));
    }
}
