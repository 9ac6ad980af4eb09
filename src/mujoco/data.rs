//! One simulation: state, step, kinematics, derivatives.

use std::ptr::NonNull;
use std::sync::Arc;

use super::bindings as mj;
use super::error::Error;
use super::model::Model;
use super::raw::{call, size, slice, slice_mut};
use super::snapshot::Snapshot;

/// The state and work space of one simulation. It can move between threads, but only one may use
/// it.
pub struct Data {
    model: Arc<Model>,
    raw: NonNull<mj::mjData>,
    poisoned: bool,
}

// SAFETY: owns its buffer, nothing in it is tied to a thread. Not Sync: kinematics and
// derivatives write to the work space.
unsafe impl Send for Data {}

/// Counters of the engine's warnings since the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Warnings {
    /// Contacts beyond `nconmax`.
    pub contact_full: u32,
    /// Constraints beyond `njmax`.
    pub constraint_full: u32,
    /// Resets because of bad qpos.
    pub bad_qpos: u32,
    /// Resets because of bad qvel.
    pub bad_qvel: u32,
    /// Resets because of bad qacc.
    pub bad_qacc: u32,
}

/// One detected contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// The two geoms.
    pub geoms: [usize; 2],
    /// Distance, m; negative inside.
    pub dist: f64,
    /// Position in the world, m.
    pub pos: [f64; 3],
    /// Normal, from the first geom to the second.
    pub normal: [f64; 3],
}

/// The work of [`Data::bare_loop`].
#[derive(Clone, Copy, Debug)]
pub struct BareLoop {
    /// Control steps to take.
    pub control_steps: usize,
    /// Simulator steps in each.
    pub substeps: usize,
    /// Control steps between resets; the controls repeat with this period.
    pub reset_every: usize,
}

macro_rules! views {
    ($($(#[$doc:meta])* $name:ident: $len:ident, $k:expr;)*) => {
        /// Read-only views, valid after [`Data::forward`], [`Data::kinematics`] or a step.
        impl Data {
            $($(#[$doc])*
            pub fn $name(&self) -> &[f64] {
                // SAFETY: the library allocates each array at this size and never moves it.
                unsafe { slice(self.get().$name, self.model.$len() * $k) }
            })*
        }
    };
}

views! {
    /// Coordinates; (nq).
    qpos: nq, 1;
    /// Velocities; (nv).
    qvel: nv, 1;
    /// Activations; (na).
    act: na, 1;
    /// Controls; (nu).
    ctrl: nu, 1;
    /// Accelerations; (nv).
    qacc: nv, 1;
    /// Gravity, Coriolis and centrifugal forces; (nv).
    qfrc_bias: nv, 1;
    /// Springs, dampers and fluid; (nv).
    qfrc_passive: nv, 1;
    /// Forces of the actuators; (nv).
    qfrc_actuator: nv, 1;
    /// Forces of contacts, limits, dry friction and equalities; (nv).
    qfrc_constraint: nv, 1;
    /// Forces computed by [`Data::inverse`]; (nv).
    qfrc_inverse: nv, 1;
    /// Actuator lengths; (nu).
    actuator_length: nu, 1;
    /// Body positions, m; (nbody, 3).
    xpos: nbody, 3;
    /// Body orientations, w x y z; (nbody, 4).
    xquat: nbody, 4;
    /// Body orientations, row-major; (nbody, 9).
    xmat: nbody, 9;
    /// Centres of mass, m; (nbody, 3).
    xipos: nbody, 3;
    /// Joint anchors in the world, m; (njnt, 3).
    xanchor: njnt, 3;
    /// Joint axes in the world; (njnt, 3).
    xaxis: njnt, 3;
    /// Geom positions, m; (ngeom, 3).
    geom_xpos: ngeom, 3;
    /// Geom orientations, row-major; (ngeom, 9).
    geom_xmat: ngeom, 9;
    /// Site positions, m; (nsite, 3).
    site_xpos: nsite, 3;
    /// Site orientations, row-major; (nsite, 9).
    site_xmat: nsite, 9;
    /// Camera positions, m; (ncam, 3).
    cam_xpos: ncam, 3;
    /// Camera orientations, row-major; (ncam, 9).
    cam_xmat: ncam, 9;
}

impl Data {
    /// A simulation at the default pose, at rest.
    ///
    /// # Errors
    /// [`Error::Memory`], [`Error::Engine`].
    pub fn new(model: &Arc<Model>) -> Result<Data, Error> {
        let mut raw = std::ptr::null_mut();
        // SAFETY: a valid model in, new data out.
        call("making a simulation", |msg| unsafe {
            mj::rb_make_data(model.ptr(), &raw mut raw, msg)
        })?;
        let raw = NonNull::new(raw).ok_or(Error::Memory { doing: "making a simulation" })?;
        Ok(Data { model: Arc::clone(model), raw, poisoned: false })
    }

    /// The simulated model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    fn get(&self) -> &mj::mjData {
        // SAFETY: valid from `new` to `drop`.
        unsafe { self.raw.as_ref() }
    }

    /// Runs a guarded engine call and records whether it corrupted the data.
    fn engine(
        &mut self,
        doing: &'static str,
        f: impl FnOnce(*const mj::mjModel, *mut mj::mjData, *mut std::ffi::c_char) -> i32,
    ) -> Result<(), Error> {
        if self.poisoned {
            return Err(Error::Poisoned);
        }
        let (m, d) = (self.model.ptr(), self.raw.as_ptr());
        let result = call(doing, |msg| f(m, d, msg)).map(drop);
        self.poisoned = result.is_err();
        result
    }

    /// Resets to the default pose at rest. It repairs poisoned data and clears the counters.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn reset(&mut self) -> Result<(), Error> {
        self.poisoned = false;
        // SAFETY: model and data belong together.
        self.engine("resetting", |m, d, msg| unsafe { mj::rb_reset(m, d, msg) })
    }

    /// Simulated time, seconds.
    pub fn time_secs(&self) -> f64 {
        self.get().time
    }

    /// Sets the simulated time, seconds.
    pub fn set_time_secs(&mut self, secs: f64) {
        // SAFETY: exclusive through `&mut self`.
        unsafe { self.raw.as_mut().time = secs }
    }

    /// Sets the coordinates; (nq).
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::NotFinite`]; the state is then unchanged.
    pub fn set_qpos(&mut self, qpos: &[f64]) -> Result<(), Error> {
        let ptr = self.get().qpos;
        self.write("qpos", ptr, self.model.nq(), qpos)
    }

    /// Sets the velocities; (nv).
    ///
    /// # Errors
    /// As [`Data::set_qpos`].
    pub fn set_qvel(&mut self, qvel: &[f64]) -> Result<(), Error> {
        let ptr = self.get().qvel;
        self.write("qvel", ptr, self.model.nv(), qvel)
    }

    /// Sets the accelerations, the input of [`Data::inverse`]; (nv).
    ///
    /// # Errors
    /// As [`Data::set_qpos`].
    pub fn set_qacc(&mut self, qacc: &[f64]) -> Result<(), Error> {
        let ptr = self.get().qacc;
        self.write("qacc", ptr, self.model.nv(), qacc)
    }

    /// Sets the controls; (nu).
    ///
    /// # Errors
    /// As [`Data::set_qpos`].
    pub fn set_ctrl(&mut self, ctrl: &[f64]) -> Result<(), Error> {
        let ptr = self.get().ctrl;
        self.write("ctrl", ptr, self.model.nu(), ctrl)
    }

    /// Sets applied generalised forces (disturbances); (nv).
    ///
    /// # Errors
    /// As [`Data::set_qpos`].
    pub fn set_qfrc_applied(&mut self, force: &[f64]) -> Result<(), Error> {
        let ptr = self.get().qfrc_applied;
        self.write("qfrc_applied", ptr, self.model.nv(), force)
    }

    #[allow(clippy::unused_self)] // the exclusive borrow is what makes the write sound
    fn write(
        &mut self,
        what: &'static str,
        ptr: *mut f64,
        len: usize,
        values: &[f64],
    ) -> Result<(), Error> {
        if values.len() != len {
            return Err(Error::Length { what, got: values.len(), want: len });
        }
        if let Some(index) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::NotFinite { what, index, value: values[index] });
        }
        // SAFETY: `ptr` is the array of this length in our own data.
        unsafe { slice_mut(ptr, len) }.copy_from_slice(values);
        Ok(())
    }

    /// Takes `substeps` simulator steps with the control held: one control step, one call.
    ///
    /// # Errors
    /// [`Error::Diverged`] when the engine met NaN and silently reset the state,
    /// [`Error::Engine`] and [`Error::Poisoned`].
    pub fn step(&mut self, substeps: usize) -> Result<(), Error> {
        let before = self.get().time;
        let resets = self.resets();
        let n = i32::try_from(substeps).unwrap_or(i32::MAX);
        // SAFETY: model and data belong together.
        self.engine("stepping", |m, d, msg| unsafe { mj::rb_step(m, d, n, msg) })?;
        let what = if self.resets() != resets {
            let w = self.warnings();
            let (qpos, qvel, _) = resets;
            if w.bad_qpos != qpos {
                "bad qpos"
            } else if w.bad_qvel != qvel {
                "bad qvel"
            } else {
                "bad qacc"
            }
        } else if self.get().time < before {
            "time went backwards"
        } else if self.qpos().iter().any(|v| !v.is_finite()) {
            "qpos is not finite"
        } else {
            return Ok(());
        };
        Err(Error::Diverged { time_secs: before, what })
    }

    fn resets(&self) -> (u32, u32, u32) {
        let w = self.warnings();
        (w.bad_qpos, w.bad_qvel, w.bad_qacc)
    }

    /// The warning counters since the last reset.
    pub fn warnings(&self) -> Warnings {
        let w = &self.get().warning;
        let n = |k: mj::mjtWarning_| u32::try_from(w[k as usize].number).unwrap_or(0);
        Warnings {
            contact_full: n(mj::mjWARN_CONTACTFULL),
            constraint_full: n(mj::mjWARN_CNSTRFULL),
            bad_qpos: n(mj::mjWARN_BADQPOS),
            bad_qvel: n(mj::mjWARN_BADQVEL),
            bad_qacc: n(mj::mjWARN_BADQACC),
        }
    }

    /// Computes everything for the current state without advancing it.
    ///
    /// # Errors
    /// [`Error::Engine`], [`Error::Poisoned`].
    pub fn forward(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.engine("forward dynamics", |m, d, msg| unsafe { mj::rb_forward(m, d, msg) })
    }

    /// Computes poses only (bodies, geoms, sites and what Jacobians need).
    ///
    /// # Errors
    /// [`Error::Engine`], [`Error::Poisoned`].
    pub fn kinematics(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.engine("kinematics", |m, d, msg| unsafe { mj::rb_kinematics(m, d, msg) })
    }

    /// Forces that would give the accelerations set by [`Data::set_qacc`]; the result is
    /// [`Data::qfrc_inverse`].
    ///
    /// # Errors
    /// [`Error::Engine`], [`Error::Poisoned`].
    pub fn inverse(&mut self) -> Result<(), Error> {
        // SAFETY: model and data belong together.
        self.engine("inverse dynamics", |m, d, msg| unsafe { mj::rb_inverse(m, d, msg) })
    }

    /// Finite-difference transition matrices of one simulator step: `a` is (2nv+na, 2nv+na), `b` is
    /// (2nv+na, nu), row-major. The state is unchanged afterwards.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Engine`], [`Error::Poisoned`].
    pub fn transition_fd(
        &mut self,
        eps: f64,
        centered: bool,
        a: &mut [f64],
        b: &mut [f64],
    ) -> Result<(), Error> {
        let n = 2 * self.model.nv() + self.model.na();
        check_len("transition A", a.len(), n * n)?;
        check_len("transition B", b.len(), n * self.model.nu())?;
        let (a, b) = (a.as_mut_ptr(), b.as_mut_ptr());
        // SAFETY: both buffers have the length that the engine writes.
        self.engine("differentiating", |m, d, msg| unsafe {
            mj::rb_transition_fd(m, d, eps, i32::from(centered), a, b, msg)
        })
    }

    /// Dense joint-space inertia; (nv, nv).
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Engine`], [`Error::Poisoned`].
    pub fn full_mass(&mut self, mass: &mut [f64]) -> Result<(), Error> {
        let nv = self.model.nv();
        check_len("mass matrix", mass.len(), nv * nv)?;
        let out = mass.as_mut_ptr();
        // SAFETY: the buffer has the length that the engine writes.
        self.engine("expanding the inertia", |m, d, msg| unsafe {
            mj::rb_full_mass(m, d, out, msg)
        })
    }

    /// Actuator moment arms, d length / d qpos; (nu, nv).
    pub fn actuator_moment(&self) -> &[f64] {
        // SAFETY: allocated at this size.
        unsafe { slice(self.get().actuator_moment, self.model.nu() * self.model.nv()) }
    }

    /// Jacobian of the equality constraints at the last forward pass; (n, nv), with a row for each
    /// number that they hold at zero. The model must have dense Jacobians
    /// ([`Model::set_dense_jacobians`]).
    pub fn equality_jacobian(&self) -> &[f64] {
        assert!(self.model.has_dense_jacobians(), "the rows would not have nv numbers");
        let d = self.get();
        // SAFETY: the engine keeps `nefc` dense rows of length nv, those of the equalities first.
        unsafe { slice(d.efc_J, size(d.ne) * self.model.nv()) }
    }

    /// Jacobian of a site: translation `jacp` and rotation `jacr`, each (3, nv).
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Engine`], [`Error::Poisoned`].
    pub fn jac_site(
        &mut self,
        site: usize,
        jacp: &mut [f64],
        jacr: &mut [f64],
    ) -> Result<(), Error> {
        self.check_jac(jacp, jacr)?;
        check_id("site", site, self.model.nsite())?;
        let (p, r) = (jacp.as_mut_ptr(), jacr.as_mut_ptr());
        // SAFETY: the id is in range and both buffers have the length that is written.
        self.engine("Jacobian", |m, d, msg| unsafe {
            mj::rb_jac_site(m, d, p, r, site as i32, msg)
        })
    }

    fn check_jac(&self, jacp: &[f64], jacr: &[f64]) -> Result<(), Error> {
        check_len("Jacobian", jacp.len(), 3 * self.model.nv())?;
        check_len("Jacobian", jacr.len(), 3 * self.model.nv())
    }

    /// The contacts of the last step or forward pass.
    pub fn contacts(&self) -> impl Iterator<Item = Contact> + '_ {
        let d = self.get();
        // SAFETY: the engine keeps `ncon` valid contacts in its buffer.
        let list = unsafe { slice(d.contact, size(d.ncon)) };
        list.iter().map(|c| Contact {
            geoms: [size(c.geom1), size(c.geom2)],
            dist: c.dist,
            pos: c.pos,
            normal: [c.frame[0], c.frame[1], c.frame[2]],
        })
    }

    /// Whether two links of the robot touch: neither is the world.
    pub fn touches_itself(&self) -> bool {
        let bodies = self.model.geom_bodyid();
        let own = |g: usize| bodies.get(g).is_some_and(|&b| b != 0);
        self.contacts().any(|c| c.dist < 0.0 && c.geoms.into_iter().all(own))
    }

    /// A snapshot of the state.
    pub fn snapshot(&self) -> Snapshot {
        let mut s = Snapshot {
            time_secs: 0.0,
            qpos: Vec::new(),
            qvel: Vec::new(),
            act: Vec::new(),
            ctrl: Vec::new(),
            qacc_warmstart: Vec::new(),
            qfrc_applied: Vec::new(),
            mocap_pos: Vec::new(),
            mocap_quat: Vec::new(),
        };
        self.snapshot_into(&mut s);
        s
    }

    /// Writes the state into an existing snapshot.
    pub fn snapshot_into(&self, s: &mut Snapshot) {
        let (d, m) = (self.get(), &self.model);
        s.time_secs = d.time;
        let copy = |to: &mut Vec<f64>, from: *mut f64, len: usize| {
            to.clear();
            // SAFETY: each array has the length of the model.
            to.extend_from_slice(unsafe { slice(from, len) });
        };
        copy(&mut s.qpos, d.qpos, m.nq());
        copy(&mut s.qvel, d.qvel, m.nv());
        copy(&mut s.act, d.act, m.na());
        copy(&mut s.ctrl, d.ctrl, m.nu());
        copy(&mut s.qacc_warmstart, d.qacc_warmstart, m.nv());
        copy(&mut s.qfrc_applied, d.qfrc_applied, m.nv());
        copy(&mut s.mocap_pos, d.mocap_pos, 3 * m.nmocap());
        copy(&mut s.mocap_quat, d.mocap_quat, 4 * m.nmocap());
    }

    /// Restores a snapshot and repairs poisoned data. Poses are stale until the next step,
    /// [`Data::forward`] or [`Data::kinematics`].
    ///
    /// # Errors
    /// [`Error::Length`] when the snapshot belongs to another model.
    pub fn restore(&mut self, s: &Snapshot) -> Result<(), Error> {
        let m = Arc::clone(&self.model);
        let arrays = {
            let d = self.get();
            [
                ("qpos", d.qpos, m.nq(), &s.qpos),
                ("qvel", d.qvel, m.nv(), &s.qvel),
                ("act", d.act, m.na(), &s.act),
                ("ctrl", d.ctrl, m.nu(), &s.ctrl),
                ("qacc_warmstart", d.qacc_warmstart, m.nv(), &s.qacc_warmstart),
                ("qfrc_applied", d.qfrc_applied, m.nv(), &s.qfrc_applied),
                ("mocap_pos", d.mocap_pos, 3 * m.nmocap(), &s.mocap_pos),
                ("mocap_quat", d.mocap_quat, 4 * m.nmocap(), &s.mocap_quat),
            ]
        };
        for (what, _, want, from) in &arrays {
            check_len(what, from.len(), *want)?;
        }
        if self.poisoned {
            self.reset()?;
        }
        for (_, to, len, from) in arrays {
            // SAFETY: lengths checked above; exclusive through `&mut self`.
            unsafe { slice_mut(to, len) }.copy_from_slice(from);
        }
        self.set_time_secs(s.time_secs);
        Ok(())
    }

    /// Steps in a plain C loop over the same library, to measure the overhead of this binding.
    /// `ctrl` is (`reset_every`, nu).
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Engine`].
    pub fn bare_loop(&mut self, ctrl: &[f64], plan: BareLoop) -> Result<(), Error> {
        check_len("control table", ctrl.len(), plan.reset_every * self.model.nu())?;
        let n = |v: usize| i32::try_from(v).unwrap_or(i32::MAX);
        let table = ctrl.as_ptr();
        // SAFETY: the table has reset_every rows of nu values.
        self.engine("bare loop", |m, d, msg| unsafe {
            let steps = n(plan.control_steps);
            mj::rb_bare_loop(m, d, table, steps, n(plan.substeps), n(plan.reset_every.max(1)), msg)
        })
    }
}

fn check_len(what: &'static str, got: usize, want: usize) -> Result<(), Error> {
    if got == want { Ok(()) } else { Err(Error::Length { what, got, want }) }
}

fn check_id(what: &'static str, got: usize, want: usize) -> Result<(), Error> {
    if got < want { Ok(()) } else { Err(Error::Length { what, got, want }) }
}

impl Drop for Data {
    fn drop(&mut self) {
        // SAFETY: owned, and dropped once.
        unsafe { mj::rb_delete_data(self.raw.as_ptr()) }
    }
}

impl std::fmt::Debug for Data {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Data")
            .field("time_secs", &self.time_secs())
            .field("qpos", &self.qpos())
            .field("poisoned", &self.poisoned)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two boxes fall on a plane and on each other; one hinge arm with a motor.
    const SCENE: &str = r#"<mujoco>
      <option timestep="0.005"/>
      <size nstack="200000"/>
      <worldbody>
        <geom type="plane" size="2 2 .1"/>
        <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
        <body pos=".05 .03 .6"><freejoint/><geom type="capsule" size=".05 .1"/></body>
        <body pos="1 0 1"><joint name="hinge" axis="0 1 0" damping=".1"/>
          <geom type="capsule" fromto="0 0 0 .5 0 0" size=".04"/><site name="tip" pos=".5 0 0"/></body>
      </worldbody>
      <actuator><motor joint="hinge" ctrlrange="-5 5" ctrllimited="true"/></actuator>
    </mujoco>"#;

    fn scene() -> Data {
        Data::new(&Arc::new(Model::from_xml(SCENE).unwrap())).unwrap()
    }

    fn bits(d: &Data) -> Vec<u64> {
        d.qpos().iter().chain(d.qvel()).map(|v| v.to_bits()).collect()
    }

    #[test]
    fn snapshot_replays_bit_exactly_with_contacts() {
        let mut d = scene();
        for _ in 0..60 {
            d.step(2).unwrap();
        }
        assert!(d.contacts().count() > 2, "the scene must be in contact");
        let s = d.snapshot();
        let run = |d: &mut Data| {
            for i in 0..100 {
                d.set_ctrl(&[(f64::from(i) * 0.3).sin() * 4.0]).unwrap();
                d.step(3).unwrap();
            }
            bits(d)
        };
        let first = run(&mut d);
        d.restore(&s).unwrap();
        assert_eq!(first, run(&mut d));
        // A second simulation without the first 60 steps replays it as well.
        let mut other = Data::new(d.model()).unwrap();
        other.restore(&s).unwrap();
        assert_eq!(first, run(&mut other));
    }

    #[test]
    fn same_bits_on_four_threads() {
        let model = Arc::new(Model::from_xml(SCENE).unwrap());
        let run = |model: &Arc<Model>| {
            let mut d = Data::new(model).unwrap();
            for i in 0..500 {
                d.set_ctrl(&[f64::from(i % 17) - 8.0]).unwrap();
                d.step(2).unwrap();
            }
            bits(&d)
        };
        let want = run(&model);
        std::thread::scope(|s| {
            let jobs: Vec<_> = (0..4).map(|_| s.spawn(|| run(&model))).collect();
            for job in jobs {
                assert_eq!(job.join().unwrap(), want);
            }
        });
    }

    #[test]
    fn silent_reset_becomes_an_error() {
        let mut d = scene();
        d.step(10).unwrap();
        let mut v = d.qvel().to_vec();
        v[12] = 1e12;
        d.set_qvel(&v).unwrap();
        let e = d.step(10).unwrap_err();
        assert!(matches!(e, Error::Diverged { .. }), "{e:?}");
        d.reset().unwrap();
        assert_eq!(d.warnings(), Warnings::default());
        d.step(10).unwrap();
    }

    #[test]
    fn non_finite_and_wrong_lengths_never_reach_the_engine() {
        let mut d = scene();
        let before = bits(&d);
        let mut q = d.qpos().to_vec();
        q[3] = f64::NAN;
        assert!(matches!(d.set_qpos(&q), Err(Error::NotFinite { what: "qpos", index: 3, .. })));
        assert!(matches!(d.set_ctrl(&[1.0, 2.0]), Err(Error::Length { got: 2, want: 1, .. })));
        assert!(matches!(d.set_ctrl(&[f64::INFINITY]), Err(Error::NotFinite { .. })));
        assert_eq!(before, bits(&d));
    }

    #[test]
    fn stack_overflow_poisons_until_reset() {
        let model = Model::from_xml(&SCENE.replace("200000", "300")).unwrap();
        let mut d = Data::new(&Arc::new(model)).unwrap();
        let e = (0..400).find_map(|_| d.step(1).err()).expect("300 numbers of stack are too few");
        assert!(matches!(&e, Error::Engine { message } if message.contains("tack")), "{e:?}");
        assert_eq!(d.step(1), Err(Error::Poisoned));
        d.reset().unwrap();
        assert!(!matches!(d.step(1), Err(Error::Poisoned)));
        // The handlers of this thread are back in place: the next simulation is sound.
        scene().step(100).unwrap();
    }

    #[test]
    fn jacobian_is_the_derivative_of_the_site() {
        let mut d = scene();
        d.kinematics().unwrap();
        let site = d.model().id(crate::Kind::Site, "tip").unwrap();
        let nv = d.model().nv();
        let (mut jp, mut jr) = (vec![0.0; 3 * nv], vec![0.0; 3 * nv]);
        d.jac_site(site, &mut jp, &mut jr).unwrap();
        let before = d.site_xpos()[3 * site..3 * site + 3].to_vec();
        let mut q = d.qpos().to_vec();
        let hinge = q.len() - 1;
        q[hinge] += 1e-6;
        d.set_qpos(&q).unwrap();
        d.kinematics().unwrap();
        for k in 0..3 {
            let numeric = (d.site_xpos()[3 * site + k] - before[k]) / 1e-6;
            assert!((numeric - jp[k * nv + nv - 1]).abs() < 1e-5);
        }
        assert!(d.jac_site(99, &mut jp, &mut jr).is_err());
    }

    #[test]
    fn inverse_undoes_forward() {
        let mut d = scene();
        d.set_ctrl(&[2.5]).unwrap();
        d.forward().unwrap();
        let qacc = d.qacc().to_vec();
        d.set_qacc(&qacc).unwrap();
        d.inverse().unwrap();
        let hinge = d.qfrc_inverse().len() - 1;
        assert!((d.qfrc_inverse()[hinge] - 2.5).abs() < 1e-9);
    }

    /// Resident memory is a figure of the whole process, so the test runs itself alone.
    #[test]
    fn a_thousand_loads_leak_nothing() {
        const ALONE: &str = "ROBERT_TEST_ALONE";
        if std::env::var_os(ALONE).is_none() {
            let status = std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", "mujoco::data::tests::a_thousand_loads_leak_nothing"])
                .env(ALONE, "1")
                .stdout(std::process::Stdio::null())
                .status()
                .unwrap();
            assert!(status.success());
            return;
        }
        let rss = || {
            let text = std::fs::read_to_string("/proc/self/statm").unwrap();
            text.split(' ').nth(1).unwrap().parse::<u64>().unwrap() * 4096
        };
        let load = || drop(scene());
        (0..50).for_each(|_| load());
        let before = rss();
        (0..1000).for_each(|_| load());
        let grown = rss().saturating_sub(before);
        assert!(grown < 8 << 20, "{} MB grown", grown >> 20);
        assert!(!std::path::Path::new("MUJOCO_LOG.TXT").exists());
    }
}
