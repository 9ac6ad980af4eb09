//! Reference pictures, drawn by the software driver only (a GPU rounds differently).
//!
//! Tolerance: a channel may differ by more than 8 on at most 0.1 % of the pixels, and by less
//! than 0.5 on average. `ROBERT_BLESS=1 cargo test golden` draws the references anew: look at
//! every one of them before they are committed.

mod scenes;

use std::io::Write;
use std::path::PathBuf;
use std::sync::{Mutex, OnceLock};

use robert::render::{Backend, Error, FrameInput, Picture, RenderConfig, Renderer, Scene, encode};
use scenes::Drawing;

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;

/// The one renderer of all tests here; none where there is no llvmpipe.
fn renderer() -> Option<&'static Mutex<Renderer>> {
    static ONE: OnceLock<Option<Mutex<Renderer>>> = OnceLock::new();
    ONE.get_or_init(|| {
        let config = RenderConfig {
            width: WIDTH,
            height: HEIGHT,
            backend: Backend::Cpu,
            ..RenderConfig::default()
        };
        match Renderer::new(config) {
            Ok(r) if r.adapter().0.contains("llvmpipe") => Some(Mutex::new(r)),
            Ok(r) => {
                skipped(&format!("goldens need llvmpipe, this is {}", r.adapter().0));
                None
            }
            Err(e) => {
                skipped(&e.to_string());
                None
            }
        }
    })
    .as_ref()
}

/// Says so past the harness, which swallows the output of tests that pass.
fn skipped(why: &str) {
    let line = format!("SKIPPED golden pictures: {why}\n");
    std::io::stderr().write_all(line.as_bytes()).unwrap();
}

fn draw(scene: &Scene, input: &FrameInput) -> Option<Picture> {
    let mut r = renderer()?.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    Some(r.draw(scene, input).unwrap())
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.png"))
}

fn load(name: &str) -> Picture {
    let bytes = std::fs::read(path(name)).unwrap_or_else(|e| panic!("golden {name}: {e}"));
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    let rgba = rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    Picture { width: info.width, height: info.height, rgba }
}

/// Why two pictures are not the same, if they are not.
fn difference(a: &Picture, b: &Picture) -> Option<String> {
    if (a.width, a.height) != (b.width, b.height) {
        return Some("other size".into());
    }
    let (mut sum, mut far) = (0_u64, 0_u64);
    for (p, q) in a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4)) {
        let d = p[..3].iter().zip(&q[..3]).map(|(x, y)| x.abs_diff(*y));
        sum += d.clone().map(u64::from).sum::<u64>();
        far += u64::from(d.max().unwrap_or(0) > 8);
    }
    let pixels = f64::from(a.width * a.height);
    let (mean, share) = (sum as f64 / (3.0 * pixels), far as f64 / pixels);
    (mean >= 0.5 || share > 0.001).then(|| {
        format!("mean difference {mean:.3} (< 0.5), {:.3} % far off (<= 0.1 %)", 100.0 * share)
    })
}

#[test]
fn pictures_are_as_they_were() {
    if renderer().is_none() {
        return;
    }
    let bless = std::env::var_os("ROBERT_BLESS").is_some();
    let mut wrong = Vec::new();
    for drawing in scenes::all() {
        let picture = drawing.with(|scene, input| draw(scene, input).unwrap());
        if bless {
            encode::save(&picture, &path(drawing.name)).unwrap();
            continue;
        }
        if let Some(why) = difference(&picture, &load(drawing.name)) {
            let kept = std::env::temp_dir().join(format!("robert-golden-{}.png", drawing.name));
            encode::save(&picture, &kept).unwrap();
            wrong.push(format!("{}: {why}; drawn now: {}", drawing.name, kept.display()));
        }
    }
    assert!(wrong.is_empty(), "pictures changed:\n{}", wrong.join("\n"));
}

/// The comparator must see what a person would: each damage alone fails the reference.
#[test]
fn a_broken_shadow_ghost_or_camera_is_seen() {
    if renderer().is_none() {
        return;
    }
    let all = scenes::all();
    let ghost: &Drawing = all.iter().find(|d| d.name == "ghost").unwrap();
    let golden = load("ghost");
    assert_eq!(ghost.with(|s, i| difference(&draw(s, i).unwrap(), &golden)), None);
    let broken = |name: &str, picture: Picture| {
        assert!(difference(&picture, &golden).is_some(), "{name} was not noticed");
    };
    ghost.with(|s, i| {
        broken("a missing ghost", draw(s, &FrameInput { ghosts: &[], ..*i }).unwrap());
        let camera = i.camera.shifted(glam::Vec3::new(0.0, 0.0, 0.004));
        broken("a camera 4 mm off", draw(s, &FrameInput { camera, ..*i }).unwrap());
        let sun = Some(glam::Vec3::new(0.6, -0.2, 1.0));
        broken("a shadow elsewhere", draw(s, &FrameInput { sun, ..*i }).unwrap());
        let config = RenderConfig {
            width: WIDTH,
            height: HEIGHT,
            backend: Backend::Cpu,
            shadows: false,
            ..RenderConfig::default()
        };
        broken("no shadow", Renderer::new(config).unwrap().draw(s, i).unwrap());
    });
}

/// A touch lies inside of what touches: it is drawn over it.
#[test]
fn a_contact_inside_a_ball_is_seen() {
    use robert::render::{Camera, Geom, Glyph, Pose, Shape, View};
    let ball =
        Geom { name: "b".into(), body: 0, shape: Shape::Sphere { radius: 0.1 }, rgba: [1.0; 4] };
    let scene = Scene::new(vec![ball], vec![], None).unwrap();
    let poses = [Pose::IDENTITY];
    let camera = Camera::fit(&scene.corners(&poses), &View::default(), 4.0 / 3.0);
    let glyph = Glyph::Contact { at: glam::Vec3::ZERO, normal: glam::Vec3::Z, length: 0.08 };
    let plain = FrameInput::new(&poses, camera);
    let Some(without) = draw(&scene, &plain) else { return };
    let with = draw(&scene, &FrameInput { glyphs: &[glyph], ..plain }).unwrap();
    let changed = with.rgba.chunks_exact(4).zip(without.rgba.chunks_exact(4));
    let vivid = changed.filter(|(a, b)| a != b && a[0] > a[1] + 60).count();
    assert!(vivid > 50, "{vivid} pixels of the arrow");
}

#[test]
fn bad_input_is_refused_or_survived() {
    let Some(renderer) = renderer() else { return };
    use robert::render::{Camera, Geom, Mesh, Pose, Shape, View};
    let ball = |radius| Geom {
        name: "b".into(),
        body: 0,
        shape: Shape::Sphere { radius },
        rgba: [1.0; 4],
    };
    let camera = Camera::fit(&[glam::Vec3::ZERO, glam::Vec3::ONE], &View::default(), 4.0 / 3.0);

    let one = Scene::new(vec![ball(0.1)], vec![], None).unwrap();
    let nan = [Pose::at(0.0, f32::NAN, 0.0)];
    let mut r = renderer.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    assert!(matches!(r.draw(&one, &FrameInput::new(&nan, camera)), Err(Error::NotFinite { .. })));
    assert!(matches!(r.draw(&one, &FrameInput::new(&[], camera)), Err(Error::PoseCount { .. })));

    let none = Scene::new(vec![ball(0.0)], vec![], None).unwrap();
    r.draw(&none, &FrameInput::new(&[Pose::IDENTITY], camera)).unwrap();
    let empty = Scene::new(vec![], vec![], None).unwrap();
    r.draw(&empty, &FrameInput::new(&[], camera)).unwrap();

    let many = Scene::new(vec![ball(0.01); 10_000], vec![], None).unwrap();
    let poses: Vec<Pose> = (0..10_000)
        .map(|i| Pose::at(0.01 * (i % 100) as f32, 0.01 * (i / 100) as f32, 0.0))
        .collect();
    r.draw(&many, &FrameInput::new(&poses, camera)).unwrap();

    // A grid of just under two million faces.
    let n = 999_u32;
    let vertices: Vec<[f32; 3]> = (0..=n)
        .flat_map(|y| (0..=n).map(move |x| [x as f32 / n as f32, y as f32 / n as f32, 0.0]))
        .collect();
    let faces: Vec<[u32; 3]> = (0..n * n)
        .flat_map(|i| {
            let a = i / n * (n + 1) + i % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        })
        .collect();
    let mesh = Mesh::new("grid", &vertices, &faces).unwrap();
    let geom = Geom { shape: Shape::Mesh { mesh: 0 }, ..ball(1.0) };
    let huge = Scene::new(vec![geom], vec![mesh], None).unwrap();
    r.draw(&huge, &FrameInput::new(&[Pose::IDENTITY], camera)).unwrap();

    for (w, h) in [(0, 0), (0, 240), (20_000, 20_000)] {
        let e = r.resize(w, h).unwrap_err();
        assert!(matches!(e, Error::Size { .. }), "{e}");
    }
    // Still whole after all that.
    r.draw(&one, &FrameInput::new(&[Pose::IDENTITY], camera)).unwrap();
}
