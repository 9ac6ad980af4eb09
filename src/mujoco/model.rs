//! A compiled model. It is immutable once shared, so any number of threads may step it.

use std::ffi::{CStr, CString};
use std::ptr::NonNull;

use super::bindings as mj;
use super::error::Error;
use super::names::Kind;
use super::raw::{call, size, slice, slice_mut};

/// A compiled model. Change it (mass, damping, gear) before it goes into an `Arc`; shared
/// references can only read it.
pub struct Model {
    raw: NonNull<mj::mjModel>,
}

// SAFETY: the model owns its buffer; nothing in it is tied to a thread.
unsafe impl Send for Model {}
// SAFETY: the engine never writes to a const mjModel, and our setters need `&mut self`.
unsafe impl Sync for Model {}

/// Joint types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joint {
    /// Six degrees of freedom, seven coordinates.
    Free,
    /// Three degrees of freedom, a quaternion.
    Ball,
    /// A translation along an axis.
    Slide,
    /// A rotation about an axis.
    Hinge,
}

/// Geom types that are drawn or collide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Geom {
    /// Infinite or sized plane, normal +z.
    Plane,
    /// Height field.
    HField,
    /// Sphere of radius `size[0]`.
    Sphere,
    /// Capsule along z: radius `size[0]`, half length `size[1]`.
    Capsule,
    /// Ellipsoid with radii size.
    Ellipsoid,
    /// Cylinder along z: radius `size[0]`, half length `size[1]`.
    Cylinder,
    /// Box with half sizes.
    Box,
    /// Triangle mesh.
    Mesh,
}

/// The mass of a body and how it is spread, in the frame of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertial {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub pos: [f64; 3],
    /// Orientation of the principal axes, w x y z.
    pub quat: [f64; 4],
    /// Principal moments of inertia about the centre of mass, kg m^2.
    pub inertia: [f64; 3],
}

/// The target of an actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transmission {
    /// This joint.
    Joint(usize),
    /// This tendon.
    Tendon(usize),
    /// Anything else (sites, slider-cranks, bodies).
    Other,
}

macro_rules! arrays {
    ($($(#[$doc:meta])* $name:ident: $ty:ty, $len:ident, $k:expr;)*) => {
        /// The arrays of `mjModel`, row-major.
        impl Model {
            $($(#[$doc])*
            #[allow(non_snake_case)]
            pub fn $name(&self) -> &[$ty] {
                let m = self.get();
                // SAFETY: the library allocates each array at this size and never moves it.
                unsafe { slice(m.$name.cast::<$ty>(), size(m.$len) * $k) }
            })*
        }
    };
}

macro_rules! sizes {
    ($($(#[$doc:meta])* $name:ident;)*) => {
        /// Sizes.
        impl Model {
            $($(#[$doc])*
            pub fn $name(&self) -> usize {
                size(self.get().$name)
            })*
        }
    };
}

/// `mjJAC_DENSE`.
const DENSE: i32 = 0;

sizes! {
    /// Generalised coordinates.
    nq;
    /// Degrees of freedom.
    nv;
    /// Actuators.
    nu;
    /// Activation states.
    na;
    /// Bodies, including the world.
    nbody;
    /// Joints.
    njnt;
    /// Geoms.
    ngeom;
    /// Sites.
    nsite;
    /// Cameras.
    ncam;
    /// Meshes.
    nmesh;
    /// Height fields.
    nhfield;
    /// Materials.
    nmat;
    /// Equality constraints.
    neq;
    /// Tendons.
    ntendon;
    /// Home keys (MJCF `<key>`).
    nkey;
    /// Mocap bodies.
    nmocap;
}

arrays! {
    /// Coordinates of the default pose; (nq).
    qpos0: f64, nq, 1;
    /// Id of the parent body; (nbody).
    body_parentid: i32, nbody, 1;
    /// Id of the body that this one is welded to; 0 is the world; (nbody).
    body_weldid: i32, nbody, 1;
    /// Joints of the body; (nbody).
    body_jntnum: i32, nbody, 1;
    /// First joint of the body, -1 for none; (nbody).
    body_jntadr: i32, nbody, 1;
    /// Degrees of freedom of the body; (nbody).
    body_dofnum: i32, nbody, 1;
    /// Geoms of the body; (nbody).
    body_geomnum: i32, nbody, 1;
    /// First geom of the body, -1 for none; (nbody).
    body_geomadr: i32, nbody, 1;
    /// Position in the parent, m; (nbody, 3).
    body_pos: f64, nbody, 3;
    /// Orientation in the parent, w x y z; (nbody, 4).
    body_quat: f64, nbody, 4;
    /// Centre of mass in the body frame, m; (nbody, 3).
    body_ipos: f64, nbody, 3;
    /// Orientation of the inertia ellipsoid, w x y z; (nbody, 4).
    body_iquat: f64, nbody, 4;
    /// Mass, kg; (nbody).
    body_mass: f64, nbody, 1;
    /// Mass of the subtree, kg; (nbody).
    body_subtreemass: f64, nbody, 1;
    /// Diagonal inertia, kg m^2; (nbody, 3).
    body_inertia: f64, nbody, 3;
    /// Joint type (`mjtJoint`); (njnt).
    jnt_type: i32, njnt, 1;
    /// First coordinate of the joint in qpos; (njnt).
    jnt_qposadr: i32, njnt, 1;
    /// First degree of freedom of the joint in qvel; (njnt).
    jnt_dofadr: i32, njnt, 1;
    /// Body that the joint moves; (njnt).
    jnt_bodyid: i32, njnt, 1;
    /// Whether the joint has limits; (njnt).
    jnt_limited: u8, njnt, 1;
    /// Anchor in the body frame, m; (njnt, 3).
    jnt_pos: f64, njnt, 3;
    /// Axis in the body frame; (njnt, 3).
    jnt_axis: f64, njnt, 3;
    /// Spring stiffness; (njnt).
    jnt_stiffness: f64, njnt, 1;
    /// Limits, rad or m; (njnt, 2).
    jnt_range: f64, njnt, 2;
    /// Body of the degree of freedom; (nv).
    dof_bodyid: i32, nv, 1;
    /// Joint of the degree of freedom; (nv).
    dof_jntid: i32, nv, 1;
    /// Dry friction, N m or N; (nv).
    dof_frictionloss: f64, nv, 1;
    /// Rotor inertia, kg m^2 or kg; (nv).
    dof_armature: f64, nv, 1;
    /// Damping, N m s/rad or N s/m; (nv).
    dof_damping: f64, nv, 1;
    /// Diagonal inertia at qpos0; (nv).
    dof_M0: f64, nv, 1;
    /// Geom type (`mjtGeom`); (ngeom).
    geom_type: i32, ngeom, 1;
    /// Contact type bits; (ngeom).
    geom_contype: i32, ngeom, 1;
    /// Contact affinity bits; (ngeom).
    geom_conaffinity: i32, ngeom, 1;
    /// Body of the geom; (ngeom).
    geom_bodyid: i32, ngeom, 1;
    /// Mesh or height field of the geom, -1 for none; (ngeom).
    geom_dataid: i32, ngeom, 1;
    /// Material of the geom, -1 for none; (ngeom).
    geom_matid: i32, ngeom, 1;
    /// Visibility group; (ngeom).
    geom_group: i32, ngeom, 1;
    /// Sizes by geom type, m; (ngeom, 3).
    geom_size: f64, ngeom, 3;
    /// Radius of the bounding sphere, m; 0 for planes; (ngeom).
    geom_rbound: f64, ngeom, 1;
    /// Position in the body frame, m; (ngeom, 3).
    geom_pos: f64, ngeom, 3;
    /// Orientation in the body frame, w x y z; (ngeom, 4).
    geom_quat: f64, ngeom, 4;
    /// Colour if no material is set; (ngeom, 4).
    geom_rgba: f32, ngeom, 4;
    /// Body of the site; (nsite).
    site_bodyid: i32, nsite, 1;
    /// Position in the body frame, m; (nsite, 3).
    site_pos: f64, nsite, 3;
    /// Orientation in the body frame, w x y z; (nsite, 4).
    site_quat: f64, nsite, 4;
    /// Sizes for drawing, m; (nsite, 3).
    site_size: f64, nsite, 3;
    /// Body of the camera; (ncam).
    cam_bodyid: i32, ncam, 1;
    /// Position in the body frame, m; (ncam, 3).
    cam_pos: f64, ncam, 3;
    /// Orientation in the body frame, w x y z; (ncam, 4).
    cam_quat: f64, ncam, 4;
    /// Vertical field of view, degrees; (ncam).
    cam_fovy: f64, ncam, 1;
    /// First vertex of the mesh; (nmesh).
    mesh_vertadr: i32, nmesh, 1;
    /// Vertices of the mesh; (nmesh).
    mesh_vertnum: i32, nmesh, 1;
    /// First face of the mesh; (nmesh).
    mesh_faceadr: i32, nmesh, 1;
    /// Faces of the mesh; (nmesh).
    mesh_facenum: i32, nmesh, 1;
    /// Vertex positions of all meshes, m; (nmeshvert, 3).
    mesh_vert: f32, nmeshvert, 3;
    /// Vertex normals of all meshes; (nmeshvert, 3).
    mesh_normal: f32, nmeshvert, 3;
    /// Vertex indices of all faces, counted within their mesh; (nmeshface, 3).
    mesh_face: i32, nmeshface, 3;
    /// Half x, half y, top, base, m; (nhfield, 4).
    hfield_size: f64, nhfield, 4;
    /// Rows of the height field; (nhfield).
    hfield_nrow: i32, nhfield, 1;
    /// Columns of the height field; (nhfield).
    hfield_ncol: i32, nhfield, 1;
    /// First sample of the height field; (nhfield).
    hfield_adr: i32, nhfield, 1;
    /// Samples of all height fields, 0..1; (nhfielddata).
    hfield_data: f32, nhfielddata, 1;
    /// Material colour; (nmat, 4).
    mat_rgba: f32, nmat, 4;
    /// Texture of the material, -1 for none; (nmat).
    mat_texid: i32, nmat, 1;
    /// Equality type (`mjtEq`); (neq).
    eq_type: i32, neq, 1;
    /// First object of the equality; (neq).
    eq_obj1id: i32, neq, 1;
    /// Second object of the equality, -1 for none; (neq).
    eq_obj2id: i32, neq, 1;
    /// Whether the equality is on; (neq).
    eq_active: u8, neq, 1;
    /// Parameters of the equality; (neq, 11).
    eq_data: f64, neq, 11;
    /// First path element of the tendon; (ntendon).
    tendon_adr: i32, ntendon, 1;
    /// Path elements of the tendon; (ntendon).
    tendon_num: i32, ntendon, 1;
    /// Whether the tendon has length limits; (ntendon).
    tendon_limited: u8, ntendon, 1;
    /// Length limits; (ntendon, 2).
    tendon_range: f64, ntendon, 2;
    /// Path element type (`mjtWrap`); (nwrap).
    wrap_type: i32, nwrap, 1;
    /// Object of the path element; (nwrap).
    wrap_objid: i32, nwrap, 1;
    /// Coefficient of the path element; (nwrap).
    wrap_prm: f64, nwrap, 1;
    /// Excluded body pairs: (body1 + 1) << 16 | (body2 + 1); (nexclude).
    exclude_signature: i32, nexclude, 1;
    /// Transmission type (`mjtTrn`); (nu).
    actuator_trntype: i32, nu, 1;
    /// Activation dynamics (`mjtDyn`); (nu).
    actuator_dyntype: i32, nu, 1;
    /// Gain type (`mjtGain`); (nu).
    actuator_gaintype: i32, nu, 1;
    /// Bias type (`mjtBias`); (nu).
    actuator_biastype: i32, nu, 1;
    /// Joint, tendon or site that is driven; (nu, 2).
    actuator_trnid: i32, nu, 2;
    /// Whether the control is limited; (nu).
    actuator_ctrllimited: u8, nu, 1;
    /// Whether the force is limited; (nu).
    actuator_forcelimited: u8, nu, 1;
    /// Gain parameters; (nu, 10).
    actuator_gainprm: f64, nu, 10;
    /// Bias parameters; (nu, 10).
    actuator_biasprm: f64, nu, 10;
    /// Control limits; (nu, 2).
    actuator_ctrlrange: f64, nu, 2;
    /// Force limits; (nu, 2).
    actuator_forcerange: f64, nu, 2;
    /// Gear: length and force scale; (nu, 6).
    actuator_gear: f64, nu, 6;
}

impl Model {
    /// The mass of the bodies that a joint moves, kg. The others are parts of the world.
    pub fn moving_mass(&self) -> f64 {
        let moves = self.body_weldid().iter().map(|w| *w != 0);
        self.body_mass().iter().zip(moves).filter(|(_, moves)| *moves).map(|(m, _)| m).sum()
    }

    /// Takes over a model from the compiler; `None` for a null pointer.
    pub(super) fn own(raw: *mut mj::mjModel) -> Option<Model> {
        NonNull::new(raw).map(|raw| Model { raw })
    }

    pub(super) fn ptr(&self) -> *const mj::mjModel {
        self.raw.as_ptr()
    }

    fn get(&self) -> &mj::mjModel {
        // SAFETY: valid from `own` to `drop`; only read through shared references.
        unsafe { self.raw.as_ref() }
    }

    fn get_mut(&mut self) -> &mut mj::mjModel {
        // SAFETY: as `get`, and `&mut self` excludes every other reference.
        unsafe { self.raw.as_mut() }
    }

    /// An independent copy, to simulate another plant.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn duplicate(&self) -> Result<Model, Error> {
        let mut raw = std::ptr::null_mut();
        // SAFETY: a valid model in, a new one out.
        call("copying the model", |msg| unsafe {
            mj::rb_copy_model(self.ptr(), &raw mut raw, msg)
        })?;
        Model::own(raw).ok_or(Error::Memory { doing: "copying the model" })
    }

    /// Simulator step, seconds.
    pub fn timestep(&self) -> f64 {
        self.get().opt.timestep
    }

    /// Sets the simulator step, seconds.
    pub fn set_timestep(&mut self, secs: f64) {
        self.get_mut().opt.timestep = secs;
    }

    /// Gravity, m/s^2; (3).
    pub fn gravity(&self) -> &[f64; 3] {
        &self.get().opt.gravity
    }

    /// Integrator: 0 Euler, 1 Runge-Kutta, 2 implicit.
    pub fn integrator(&self) -> i32 {
        self.get().opt.integrator
    }

    /// Friction cone: 0 pyramidal, 1 elliptic.
    pub fn cone(&self) -> i32 {
        self.get().opt.cone
    }

    /// Centre of the model at qpos0, m; (3).
    pub fn center(&self) -> [f64; 3] {
        self.get().stat.center
    }

    /// Extent of the model at qpos0, m.
    pub fn extent(&self) -> f64 {
        self.get().stat.extent
    }

    /// Switches contacts on or off (`mjDSBL_CONTACT`).
    pub fn set_contacts(&mut self, on: bool) {
        let bit = mj::mjDSBL_CONTACT as i32;
        let flags = &mut self.get_mut().opt.disableflags;
        *flags = if on { *flags & !bit } else { *flags | bit };
    }

    /// Whether contacts are on.
    pub fn contacts(&self) -> bool {
        self.get().opt.disableflags & mj::mjDSBL_CONTACT as i32 == 0
    }

    /// Switches equality constraints on or off (`mjDSBL_EQUALITY`).
    pub fn set_equalities(&mut self, on: bool) {
        let bit = mj::mjDSBL_EQUALITY as i32;
        let flags = &mut self.get_mut().opt.disableflags;
        *flags = if on { *flags & !bit } else { *flags | bit };
    }

    /// Lets the engine store the Jacobians of constraints as dense rows, whatever their size.
    pub fn set_dense_jacobians(&mut self) {
        self.get_mut().opt.jacobian = DENSE;
    }

    /// Whether [`Model::set_dense_jacobians`] was called, or the file says so.
    pub fn has_dense_jacobians(&self) -> bool {
        self.get().opt.jacobian == DENSE
    }

    /// Coordinates of the home keys; (nkey, nq).
    pub fn key_qpos(&self) -> &[f64] {
        let m = self.get();
        // SAFETY: allocated at this size by the compiler.
        unsafe { slice(m.key_qpos, size(m.nkey) * size(m.nq)) }
    }

    /// Scales every mass and inertia, for a heavier or lighter plant.
    ///
    /// # Errors
    /// [`Error::Engine`], [`Error::Memory`] from recomputing derived values.
    pub fn scale_mass(&mut self, factor: f64) -> Result<(), Error> {
        let m = self.get_mut();
        let n = size(m.nbody);
        // SAFETY: allocated at these sizes; `&mut self` is exclusive.
        let (mass, inertia) =
            unsafe { (slice_mut(m.body_mass, n), slice_mut(m.body_inertia, 3 * n)) };
        mass.iter_mut().chain(inertia).for_each(|v| *v *= factor);
        self.set_const()
    }

    /// The inertial frame of a body.
    ///
    /// # Panics
    /// If there is no such body.
    pub fn inertial(&self, body: usize) -> Inertial {
        let three = |x: &[f64]| std::array::from_fn(|i| x[3 * body + i]);
        Inertial {
            mass: self.body_mass()[body],
            pos: three(self.body_ipos()),
            quat: std::array::from_fn(|i| self.body_iquat()[4 * body + i]),
            inertia: three(self.body_inertia()),
        }
    }

    /// Replaces the inertial frame of a body.
    ///
    /// # Errors
    /// As [`Model::scale_mass`].
    ///
    /// # Panics
    /// If there is no such body.
    pub fn set_inertial(&mut self, body: usize, new: Inertial) -> Result<(), Error> {
        let m = self.get_mut();
        let (nbody, nv) = (size(m.nbody), size(m.nv));
        // SAFETY: allocated at these sizes; `&mut self` is exclusive.
        unsafe {
            slice_mut(m.body_mass, nbody)[body] = new.mass;
            slice_mut(m.body_ipos, 3 * nbody)[3 * body..][..3].copy_from_slice(&new.pos);
            slice_mut(m.body_iquat, 4 * nbody)[4 * body..][..4].copy_from_slice(&new.quat);
            slice_mut(m.body_inertia, 3 * nbody)[3 * body..][..3].copy_from_slice(&new.inertia);
            // The compiler found short cuts for the old frame.
            slice_mut(m.body_sameframe, nbody)[body] = 0;
            slice_mut(m.body_simple, nbody)[body] = 0;
            slice_mut(m.dof_simplenum, nv).fill(0);
        }
        self.set_const()
    }

    /// Scales the damping of every degree of freedom.
    pub fn scale_damping(&mut self, factor: f64) {
        let m = self.get_mut();
        // SAFETY: allocated at this size; `&mut self` is exclusive.
        let damping = unsafe { slice_mut(m.dof_damping, size(m.nv)) };
        damping.iter_mut().for_each(|v| *v *= factor);
    }

    /// Sets the damping of every degree of freedom; (nv).
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn set_damping(&mut self, damping: &[f64]) -> Result<(), Error> {
        let m = self.get_mut();
        // SAFETY: allocated at this size; `&mut self` is exclusive.
        let own = unsafe { slice_mut(m.dof_damping, size(m.nv)) };
        if own.len() != damping.len() {
            return Err(Error::Length { what: "damping", got: damping.len(), want: own.len() });
        }
        own.copy_from_slice(damping);
        Ok(())
    }

    /// Scales the force per control of every actuator.
    pub fn scale_gear(&mut self, factor: f64) {
        let m = self.get_mut();
        // SAFETY: allocated at this size; `&mut self` is exclusive.
        let gear = unsafe { slice_mut(m.actuator_gear, 6 * size(m.nu)) };
        gear.iter_mut().for_each(|v| *v *= factor);
    }

    /// Recomputes the values that the compiler derived from masses and frames.
    fn set_const(&mut self) -> Result<(), Error> {
        let raw = self.raw.as_ptr();
        // SAFETY: exclusive through `&mut self`.
        call("updating the model", |msg| unsafe { mj::rb_set_const(raw, msg) }).map(drop)
    }

    /// Name of an object; `None` if it has no name or does not exist.
    pub fn name(&self, kind: Kind, id: usize) -> Option<&str> {
        let id = i32::try_from(id).ok()?;
        // SAFETY: the library checks the id; names live as long as the model.
        let text = unsafe {
            let p = mj::rb_name(self.ptr(), kind.raw(), id);
            if p.is_null() {
                return None;
            }
            CStr::from_ptr(p)
        };
        text.to_str().ok().filter(|s| !s.is_empty())
    }

    /// Id of a named object.
    pub fn id(&self, kind: Kind, name: &str) -> Option<usize> {
        let name = CString::new(name).ok()?;
        // SAFETY: a NUL-terminated string that outlives the call.
        let id = unsafe { mj::rb_id(self.ptr(), kind.raw(), name.as_ptr()) };
        usize::try_from(id).ok()
    }

    /// Type of a joint.
    pub fn joint_type(&self, joint: usize) -> Option<Joint> {
        Some(match self.jnt_type().get(joint).copied()? as u32 {
            mj::mjJNT_FREE => Joint::Free,
            mj::mjJNT_BALL => Joint::Ball,
            mj::mjJNT_SLIDE => Joint::Slide,
            _ => Joint::Hinge,
        })
    }

    /// Type of a geom; `None` for types that are never drawn.
    pub fn geom_kind(&self, geom: usize) -> Option<Geom> {
        Some(match self.geom_type().get(geom).copied()? as u32 {
            mj::mjGEOM_PLANE => Geom::Plane,
            mj::mjGEOM_HFIELD => Geom::HField,
            mj::mjGEOM_SPHERE => Geom::Sphere,
            mj::mjGEOM_CAPSULE => Geom::Capsule,
            mj::mjGEOM_ELLIPSOID => Geom::Ellipsoid,
            mj::mjGEOM_CYLINDER => Geom::Cylinder,
            mj::mjGEOM_BOX => Geom::Box,
            mj::mjGEOM_MESH => Geom::Mesh,
            _ => return None,
        })
    }

    /// Colour of a geom (that of its material if it has one); linear RGBA as in the file.
    pub fn geom_color(&self, geom: usize) -> Option<[f32; 4]> {
        let row = |a: &[f32], i: usize| a.get(4 * i..4 * i + 4).and_then(|s| s.try_into().ok());
        match usize::try_from(self.geom_matid().get(geom).copied()?) {
            Ok(mat) => row(self.mat_rgba(), mat),
            Err(_) => row(self.geom_rgba(), geom),
        }
    }

    /// The target of an actuator.
    pub fn transmission(&self, actuator: usize) -> Option<Transmission> {
        let kind = self.actuator_trntype().get(actuator).copied()? as u32;
        let id = usize::try_from(self.actuator_trnid().get(2 * actuator).copied()?).ok()?;
        Some(match kind {
            mj::mjTRN_JOINT | mj::mjTRN_JOINTINPARENT => Transmission::Joint(id),
            mj::mjTRN_TENDON => Transmission::Tendon(id),
            _ => Transmission::Other,
        })
    }
}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: owned, and dropped once.
        unsafe { mj::rb_delete_model(self.raw.as_ptr()) }
    }
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Model")
            .field("nq", &self.nq())
            .field("nv", &self.nv())
            .field("nu", &self.nu())
            .field("ngeom", &self.ngeom())
            .finish_non_exhaustive()
    }
}
