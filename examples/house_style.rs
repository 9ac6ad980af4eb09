//! Run with: cargo run --example `house_style` -- FOLDER
//!
//! Draws every kind of chart from made-up numbers.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use robert::plot::{
    Axis, Curve, Figure, JointTrack, Theme, bars, coverage, curves, histogram, joints, precision,
    xy,
};

/// A number in 0..1 that looks random.
fn noise(k: usize) -> f64 {
    let x = (k as f64 * 12.9898).sin() * 43_758.545;
    x - x.floor()
}

fn main() {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    let folder = Path::new(&folder);
    let curve = |name: &str, level: f64, seed: usize| {
        let points: Vec<(f64, f64)> = (0..200)
            .map(|f| {
                let dip = if (60..110).contains(&f) { 0.6 } else { 1.0 };
                let wobble =
                    0.4 * (f as f64 * 0.07 + level * 9.0).sin().abs() + 0.1 * noise(f + seed);
                (f as f64, level * dip * (0.5 + wobble))
            })
            .collect();
        let ci95 = points.iter().map(|p| 0.18 * p.1).collect();
        Curve { name: name.into(), points, ci95 }
    };
    let methods = [curve("RoBERT", 0.05, 0), curve("iLQR", 0.08, 7), curve("PD", 0.16, 99)];
    let chart =
        precision("fire a handgun", &methods, "rad", &[(60.0, 110.0), (150.0, 165.0)], 20.0)
            .note("Shadow Hand, 3 seeds, band = 95 % interval");
    chart.save(&folder.join("precision.png")).unwrap();
    chart.save(&folder.join("precision.svg")).unwrap();
    chart.theme(Theme::Dark).save(&folder.join("precision_dark.png")).unwrap();

    let names = ["FFJ4", "FFJ3", "FFJ2", "FFJ1", "MFJ4", "MFJ3", "MFJ2", "MFJ1"];
    let tracks: Vec<JointTrack> = names
        .iter()
        .enumerate()
        .map(|(i, n)| {
            let goal = |f: usize| 0.8 * ((f as f64) * 0.03 + i as f64).sin();
            let seen =
                |f: usize| if i < 4 { !(60..=120).contains(&f) } else { f.is_multiple_of(40) };
            JointTrack {
                name: (*n).into(),
                unit: "rad".into(),
                commanded: (0..200).map(|f| if seen(f) { goal(f) } else { f64::NAN }).collect(),
                achieved: (0..200_usize)
                    .map(|f| goal(f.saturating_sub(4)) + 0.03 * noise(f))
                    .collect(),
            }
        })
        .collect();
    joints("commanded and achieved", &tracks, 20.0).save(&folder.join("joints.png")).unwrap();

    let star = |k: usize| {
        let a = std::f64::consts::TAU * (k as f64 * 2.0 / 5.0) + std::f64::consts::FRAC_PI_2;
        (0.5 * a.cos(), 0.5 * a.sin())
    };
    let path: Vec<(f64, f64)> = (0..200)
        .map(|f| {
            let (k, s) = (f / 40, (f % 40) as f64 / 40.0);
            let (a, b) = (star(k), star(k + 1));
            let s = s * s * (3.0 - 2.0 * s);
            (a.0 + (b.0 - a.0) * s + 0.01 * noise(f), a.1 + (b.1 - a.1) * s + 0.01 * noise(f + 500))
        })
        .collect();
    let achieved = Curve { name: "achieved".into(), points: path.clone(), ci95: vec![] };
    let commanded: Vec<(f64, f64)> = (0..=5).map(star).collect();
    let axis = |name| Axis::new(name, "m");
    let star = xy("pointmass: star", &[achieved], &commanded, axis("x"), axis("y"));
    star.save(&folder.join("xy.png")).unwrap();

    let loss = |name: &str, end: f64| Curve {
        name: name.into(),
        points: (0..300)
            .map(|i| {
                (i as f64 * 1000.0, end + 0.9 * (-(i as f64) / 40.0).exp() * (0.8 + 0.4 * noise(i)))
            })
            .collect(),
        ci95: vec![],
    };
    curves(
        "training",
        &[loss("train", 0.02), loss("validation", 0.035)],
        Axis::new("step", ""),
        Axis::new("loss", "").log(),
    )
    .save(&folder.join("curves.png"))
    .unwrap();

    let groups: Vec<String> = ["six", "thumb", "rock", "gun", "count"].map(String::from).to_vec();
    let set = |name: &str, level: f64| {
        let one = |i: usize| (level * (0.7 + 0.6 * noise(i + 3)), 0.2 * level);
        (name.to_owned(), (0..5).map(one).collect::<Vec<_>>())
    };
    bars(
        "precision by task",
        &groups,
        &[set("RoBERT", 0.05), set("iLQR", 0.08), set("PD", 0.15)],
        Axis::new("precision", "rad"),
    )
    .note("3 seeds, 95 % intervals")
    .save(&folder.join("bars.png"))
    .unwrap();

    let cloud: Vec<(f64, f64)> = (0..20_000)
        .map(|k| {
            let (r, a) = (
                (-2.0 * noise(k).max(1e-9).ln()).sqrt(),
                std::f64::consts::TAU * noise(k + 40_000),
            );
            (0.5 * r * a.cos(), 0.3 * r * a.sin() + 0.4 * (r * a.cos()).powi(2))
        })
        .collect();
    let q: Vec<f64> = cloud.iter().map(|p| p.0).collect();
    let panels = vec![
        histogram("shoulder_pan", &q, 40, Axis::new("angle", "rad")),
        coverage("pan against lift", &cloud, 48, Axis::new("pan", "rad"), Axis::new("lift", "rad")),
    ];
    Figure::grid("coverage of the dataset", panels, 2)
        .panel_size(420, 340)
        .save(&folder.join("coverage.png"))
        .unwrap();
}
