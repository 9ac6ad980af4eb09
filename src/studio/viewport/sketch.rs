//! Projects a line that was drawn over a page's picture onto a plane in the world.

use super::space::{self, V3};
use super::stage::Stage;
use crate::protocol::{Error, Plane};

/// A plane seen under a smaller angle than this (its sine) is too oblique to draw on.
const EDGE_ON: f64 = 0.02;
/// Points farther from the eye than this many distances of the site are refused.
const FAR: f64 = 20.0;

impl Stage {
    /// The place of a line in the world: x, y, z in m, and seconds. Points of the picture are 0 to
    /// 1 from its top left corner.
    pub(super) fn sketch(
        &self,
        tab: &str,
        points: &[[f64; 3]],
        plane: Plane,
        site: &str,
    ) -> Result<Vec<[f64; 4]>, Error> {
        let camera = self.cameras.of(tab).ok_or_else(|| {
            Error::request("the 3D view has not said yet where its camera stands; move it once")
        })?;
        let missing = || Error::NotFound { what: format!("site {site}") };
        let tip = self.site_place(site).ok_or_else(missing)?;
        let up = [0.0, 0.0, 1.0];
        let (through, normal): (V3, V3) = match plane {
            Plane::Ground => ([0.0; 3], up),
            Plane::Level => (tip, up),
            Plane::View => (tip, camera.forward()),
        };
        let reach = FAR * space::norm(space::sub(tip, camera.eye)).max(0.01);
        let mut line = Vec::with_capacity(points.len());
        for [x, y, secs] in points {
            let ray = space::direction(camera.ray([*x, *y]));
            let slope = space::dot(ray, normal);
            let far = space::dot(space::sub(through, camera.eye), normal) / slope;
            if slope.abs() < EDGE_ON || !(0.0..reach).contains(&far) {
                let what = "the line leaves the plane that it is drawn on: look at the plane from above, \
                            or draw on the plane that faces you";
                return Err(Error::request(what));
            }
            let [x, y, z] = space::add(camera.eye, space::scale(ray, far));
            line.push([x, y, z, *secs]);
        }
        Ok(line)
    }
}
