//! LAFAN CSV: `x y z qx qy qz qw` of the base, then the joints; neither header nor rate.

use super::super::error::Error;
use super::samples::{Samples, at_line, foreign, rate};
use robert_base::limits;

/// Columns of the base.
const BASE: usize = 7;

/// Reads rows of a robot with these joints, in the model's order. The base is skipped, because
/// clips have none.
///
/// # Errors
/// [`Error::Foreign`] with the line.
pub fn from_lafan(bytes: &[u8], joints: &[String], fps: f64) -> Result<Samples, Error> {
    // The reader would keep a place for each cell of a line before it could be refused.
    let most = BASE + limits::JOINTS;
    for (i, text) in bytes.split(|b| *b == b'\n').enumerate() {
        let columns = text.split(|b| *b == b',').count();
        if columns > most {
            return Err(at_line(i + 1, format!("{columns} columns; at most {most} are read")));
        }
    }
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(bytes);
    let mut rows = Vec::new();
    for (i, record) in reader.records().enumerate() {
        let record = record.map_err(|e| foreign(format!("this is not CSV: {e}")))?;
        let line = record.position().map_or(i + 1, |p| p.line() as usize);
        if record.len() != BASE + joints.len() {
            return Err(at_line(
                line,
                format!(
                    "{} columns; {} of the base and {} joints are wanted",
                    record.len(),
                    BASE,
                    joints.len()
                ),
            ));
        }
        if rows.len() >= limits::CLIP_FRAMES as usize {
            return Err(at_line(line, "more rows than a clip can hold"));
        }
        let number = |cell: &str| {
            let value = cell.parse::<f64>().ok().filter(|v| v.is_finite());
            value.ok_or_else(|| at_line(line, format!("{cell:?} is no number")))
        };
        rows.push(record.iter().skip(BASE).map(number).collect::<Result<Vec<f64>, _>>()?);
    }
    if rows.is_empty() {
        return Err(foreign("there are no rows"));
    }
    Ok(Samples::steady(joints.to_vec(), rate(fps)?, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_have_a_line() {
        let joints = ["a".to_owned(), "b".to_owned()];
        let read = |text: &str| from_lafan(text.as_bytes(), &joints, 30.0);
        let good = read("0,0,1,0,0,0,1,0.5,-2\n0,0,1,0,0,0,1,0.6,-3\n").unwrap();
        assert_eq!(good.rows, [[0.5, -2.0], [0.6, -3.0]]);
        assert!((good.secs[1] - 1.0 / 30.0).abs() < 1e-12);
        for (text, words) in [
            ("0,0,1,0,0,0,1,0.5,-2\n0,0,1\n", "line 2: 3 columns"),
            ("0,0,1,0,0,0,1,0.5,x\n", "line 1: \"x\" is no number"),
            ("0,0,1,0,0,0,1,0.5,nan\n", "no number"),
            ("", "no rows"),
        ] {
            let e = read(text).unwrap_err().to_string();
            assert!(e.contains(words), "{text}: {e}");
        }
        assert!(from_lafan(b"0,0,1,0,0,0,1,1,2\n", &joints, 0.0).is_err());
    }
}
