//! Compiles models from a file or from bytes in memory.

use std::ffi::CString;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

use super::VERSION;
use super::bindings as mj;
use super::error::Error;
use super::model::Model;
use super::raw::call;
use robert_base::limits;

/// One model is compiled at a time: the library keeps a global "last XML".
static COMPILER: Mutex<()> = Mutex::new(());

/// Checks once that the installed library has the version of our layouts.
///
/// # Errors
/// [`Error::Version`].
pub fn check_library() -> Result<(), Error> {
    static CHECKED: OnceLock<i32> = OnceLock::new();
    // SAFETY: a pure function without arguments.
    let got = *CHECKED.get_or_init(|| unsafe { mj::rb_version() });
    if got == VERSION { Ok(()) } else { Err(Error::Version { got, want: VERSION }) }
}

impl Model {
    /// Compiles MJCF text.
    ///
    /// # Errors
    /// [`Error::Parse`], [`Error::Compile`], [`Error::Invalid`], [`Error::Memory`].
    pub fn from_xml(xml: &str) -> Result<Model, Error> {
        Model::from_assets("model.xml", &[("model.xml", xml.as_bytes())])
    }

    /// Compiles the file called `root` among these in-memory files.
    ///
    /// Names are compared without folder and without case. Files that are not among them are read
    /// from disk, so this is not a sandbox.
    ///
    /// # Errors
    /// As [`Model::from_xml`].
    pub fn from_assets(root: &str, files: &[(&str, &[u8])]) -> Result<Model, Error> {
        let bad = |what: &str| Error::Invalid { message: what.to_owned(), path: None };
        let root_c = CString::new(root).or(Err(bad("a file name contains a NUL byte")))?;
        let names = files
            .iter()
            .map(|(n, _)| CString::new(*n).or(Err(bad("a file name contains a NUL byte"))))
            .collect::<Result<Vec<_>, _>>()?;
        let assets = names
            .iter()
            .zip(files)
            .map(|(name, (_, bytes))| {
                let size = i32::try_from(bytes.len()).or(Err(bad("a file is larger than 2 GB")))?;
                Ok(mj::RbAsset { name: name.as_ptr(), bytes: bytes.as_ptr().cast(), size })
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let count = i32::try_from(assets.len()).or(Err(bad("too many files")))?;
        // SAFETY: names and bytes outlive the call; the shim copies what it needs.
        compile(|out, msg| unsafe {
            mj::rb_load_assets(root_c.as_ptr(), assets.as_ptr(), count, out, msg)
        })
    }

    /// Compiles an MJCF (or URDF) file; includes and meshes are read from disk.
    ///
    /// Foreign files must have passed the pre-parse and the compile check in a child
    /// process (see the crate `robert-robot`): some take the library minutes or all memory.
    ///
    /// # Errors
    /// As [`Model::from_xml`], with the path.
    pub fn from_path(path: &Path) -> Result<Model, Error> {
        let name = CString::new(path.as_os_str().as_bytes()).or(Err(Error::Invalid {
            message: "the path contains a NUL byte".into(),
            path: None,
        }))?;
        // SAFETY: the path outlives the call.
        compile(|out, msg| unsafe { mj::rb_load_path(name.as_ptr(), out, msg) })
            .map_err(|e| e.at(path))
    }
}

fn compile(
    load: impl FnOnce(*mut *mut mj::mjModel, *mut std::ffi::c_char) -> i32,
) -> Result<Model, Error> {
    check_library()?;
    // Poisoned only if a thread panicked inside the guard; the library has no state to repair.
    let lock = COMPILER.lock().unwrap_or_else(PoisonError::into_inner);
    let mut raw = std::ptr::null_mut();
    let warning = call("compiling the model", |msg| load(&raw mut raw, msg))?;
    drop(lock);
    let model = Model::own(raw).ok_or(Error::Memory { doing: "compiling the model" })?;
    if !warning.is_empty() {
        tracing::warn!("{}", warning.trim().replace('\n', "; "));
    }
    validate(&model)?;
    Ok(model)
}

/// Checks for models that the compiler accepts although they cannot be simulated.
fn validate(m: &Model) -> Result<(), Error> {
    let invalid = |message: String| Err(Error::Invalid { message, path: None });
    let dt = m.timestep();
    if !(1e-5..=0.1).contains(&dt) {
        return invalid(format!("timestep is {dt} s, not within 0.00001 to 0.1 s"));
    }
    if m.nq() > limits::MODEL_NQ {
        return invalid(format!(
            "{} coordinates; at most {} are supported",
            m.nq(),
            limits::MODEL_NQ
        ));
    }
    let vectors: [(&str, &[f64]); 14] = [
        ("qpos0", m.qpos0()),
        ("body pos", m.body_pos()),
        ("body quat", m.body_quat()),
        ("body mass", m.body_mass()),
        ("body inertia", m.body_inertia()),
        ("joint axis", m.jnt_axis()),
        ("joint range", m.jnt_range()),
        ("joint damping", m.dof_damping()),
        ("joint armature", m.dof_armature()),
        ("geom size", m.geom_size()),
        ("geom pos", m.geom_pos()),
        ("actuator gear", m.actuator_gear()),
        ("actuator ctrlrange", m.actuator_ctrlrange()),
        ("gravity", m.gravity()),
    ];
    for (what, values) in vectors {
        if let Some(i) = values.iter().position(|v| !v.is_finite() || v.abs() > 1e12) {
            let v = values[i];
            return invalid(format!("{what}[{i}] is {v}, beyond any physical model"));
        }
    }
    if let Some(i) = m.dof_damping().iter().position(|&d| d < 0.0) {
        return invalid(format!(
            "joint damping[{i}] is negative: the simulation would gain energy"
        ));
    }
    let quats = m.body_quat().chunks_exact(4);
    for (i, q) in quats.enumerate() {
        let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > 1e-6 {
            return invalid(format!("the quaternion of body {i} has length {norm}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_have_a_limit_of_coordinates() {
        let wide = |joints: usize| {
            let body = "<body><joint/><geom size=\".1\"/></body>".repeat(joints);
            Model::from_xml(&format!("<mujoco><worldbody>{body}</worldbody></mujoco>"))
        };
        assert_eq!(wide(limits::MODEL_NQ).unwrap().nq(), limits::MODEL_NQ);
        let refused = wide(limits::MODEL_NQ + 1).unwrap_err().to_string();
        assert!(refused.contains("1025 coordinates; at most 1024"), "{refused}");
    }

    #[test]
    fn refusals_have_a_class_and_a_line() {
        let syntax = Model::from_xml("<mujoco>\n<worldbody>\n</mujoco>").unwrap_err();
        assert!(matches!(syntax, Error::Parse { line: Some(_), .. }), "{syntax:?}");
        let schema = Model::from_xml("<mujoco>\n<worldbdy/>\n</mujoco>").unwrap_err();
        assert!(matches!(schema, Error::Parse { line: Some(2), .. }), "{schema:?}");
        let compile = Model::from_xml(
            "<mujoco><worldbody>\n<body><joint/><geom size=\".1\" mass=\"-1\"/></body></worldbody></mujoco>",
        )
        .unwrap_err();
        assert!(matches!(compile, Error::Compile { .. }), "{compile:?}");
        let timestep = Model::from_xml("<mujoco><option timestep=\"-1\"/></mujoco>").unwrap_err();
        assert!(matches!(timestep, Error::Invalid { .. }), "{timestep:?}");
        let empty = Model::from_xml("").unwrap_err();
        assert!(matches!(empty, Error::Invalid { .. }), "{empty:?}");
    }

    #[test]
    fn assets_that_share_a_name_are_refused() {
        let e = Model::from_assets(
            "m.xml",
            &[("m.xml", b"<mujoco/>"), ("a/Foo.obj", b"x"), ("foo.OBJ", b"y")],
        );
        assert!(matches!(e, Err(Error::Invalid { .. })), "{e:?}");
        let long = "x".repeat(1200);
        let e = Model::from_assets(&long, &[(&long, b"<mujoco/>")]);
        assert!(matches!(e, Err(Error::Invalid { .. })), "{e:?}");
    }

    #[test]
    fn a_plant_that_differs_is_a_copy() {
        let m = Model::from_xml(
            r#"<mujoco><worldbody><body><joint damping="2"/><geom size=".1" mass="3"/></body></worldbody></mujoco>"#,
        )
        .unwrap();
        let mut other = m.duplicate().unwrap();
        other.scale_mass(2.0).unwrap();
        other.scale_damping(0.5);
        assert!((other.body_mass()[1] - 6.0).abs() < 1e-12);
        assert!((other.body_subtreemass()[0] - 6.0).abs() < 1e-12, "derived values must follow");
        assert!((m.body_mass()[1] - 3.0).abs() < 1e-12);
        assert!((other.dof_damping()[0] - 1.0).abs() < 1e-12);
    }
}
