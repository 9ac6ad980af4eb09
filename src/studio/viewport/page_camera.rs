//! The camera positions of the pages.

use std::collections::BTreeMap;

use super::space::{self, V3};
use robert_base::limits;

/// The cameras of all pages.
#[derive(Debug, Default)]
pub(super) struct PageCameras {
    by_page: BTreeMap<String, PageCamera>,
    /// Whether the cameras have been set for the whole motion of the document.
    pub(super) framed: bool,
}

impl PageCameras {
    /// A page's camera has moved.
    pub(super) fn moved(&mut self, tab: String, camera: PageCamera) {
        // Pages come and go; the camera of a forgotten page is sent again when it moves.
        if self.by_page.len() >= limits::CLIENTS && !self.by_page.contains_key(&tab) {
            self.by_page.pop_first();
        }
        self.by_page.insert(tab, camera);
    }

    /// The camera of a page.
    pub(super) fn of(&self, tab: &str) -> Option<&PageCamera> {
        self.by_page.get(tab)
    }
}

/// A page's camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PageCamera {
    /// The position, m.
    pub(super) eye: V3,
    /// From its own axes (x right, y down, z ahead) to the world's.
    pub(super) turn: space::Q,
    /// Tangent of half the vertical field of view.
    pub(super) slope: f64,
    /// Width over height.
    pub(super) aspect: f64,
}

impl PageCamera {
    /// The direction in which it looks.
    pub(super) fn forward(&self) -> V3 {
        space::rotate(self.turn, [0.0, 0.0, 1.0])
    }

    /// The direction of a point of the picture, 0 to 1 from the top left corner.
    pub(super) fn ray(&self, [x, y]: [f64; 2]) -> V3 {
        let side = (2.0 * x - 1.0) * self.slope * self.aspect;
        space::rotate(self.turn, [side, (2.0 * y - 1.0) * self.slope, 1.0])
    }
}
