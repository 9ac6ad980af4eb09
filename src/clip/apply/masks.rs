//! Edits of mask spans.

use std::collections::{BTreeMap, BTreeSet};

use super::edit::Edit;
use super::error::{Done, argument};
use crate::document::Mask;
use crate::op::MaskSet;

impl Edit<'_> {
    pub(super) fn mask_set(&mut self, a: &MaskSet) -> Done {
        let (from, to) = (a.from, a.to);
        if from >= to || to > self.clip.length {
            let length = self.clip.length;
            return argument(format!(
                "the span {from}..{to} must be increasing and inside 0..{length}"
            ));
        }
        let chosen: Option<BTreeSet<usize>> = match &a.joints {
            None => None,
            Some(names) => Some(names.iter().map(|n| self.joint(n)).collect::<Result<_, _>>()?),
        };
        let all = self.clip.dim();
        let chosen = chosen.filter(|set| set.len() < all);
        if chosen.as_ref().is_some_and(BTreeSet::is_empty) {
            return argument("an empty joint list masks nothing");
        }
        if a.masked {
            let joints = chosen.as_ref().map(|set| self.names(set));
            self.clip.masks.push(Mask { from, to, joints });
        } else {
            let old = std::mem::take(&mut self.clip.masks);
            for mask in old {
                self.cut_mask(mask, from, to, chosen.as_ref())?;
            }
        }
        merge_masks(&mut self.clip.masks);
        Ok(())
    }

    /// The part of a mask that remains: everything outside `from..to`, and inside it the other
    /// joints.
    pub(super) fn cut_mask(
        &mut self,
        mask: Mask,
        from: u32,
        to: u32,
        chosen: Option<&BTreeSet<usize>>,
    ) -> Done {
        if mask.to <= from || mask.from >= to {
            self.clip.masks.push(mask);
            return Ok(());
        }
        let (inner_from, inner_to) = (mask.from.max(from), mask.to.min(to));
        if let Some(chosen) = chosen {
            let mut left: BTreeSet<usize> = match &mask.joints {
                None => (0..self.clip.dim()).collect(),
                Some(names) => names.iter().map(|n| self.joint(n)).collect::<Result<_, _>>()?,
            };
            left.retain(|j| !chosen.contains(j));
            if !left.is_empty() {
                let joints = Some(self.names(&left));
                self.clip.masks.push(Mask { from: inner_from, to: inner_to, joints });
            }
        }
        for (a, b) in [(mask.from, inner_from), (inner_to, mask.to)] {
            if a < b {
                self.clip.masks.push(Mask { from: a, to: b, joints: mask.joints.clone() });
            }
        }
        Ok(())
    }
}

/// Joins spans of the same joints that touch or overlap.
pub(super) fn merge_masks(masks: &mut Vec<Mask>) {
    let mut by_joints: BTreeMap<Option<Vec<String>>, Vec<(u32, u32)>> = BTreeMap::new();
    for mask in masks.drain(..) {
        by_joints.entry(mask.joints).or_default().push((mask.from, mask.to));
    }
    for (joints, mut spans) in by_joints {
        spans.sort_unstable();
        let mut joined: Vec<(u32, u32)> = Vec::new();
        for (from, to) in spans {
            match joined.last_mut() {
                Some(last) if from <= last.1 => last.1 = last.1.max(to),
                _ => joined.push((from, to)),
            }
        }
        let joints = &joints;
        masks.extend(joined.into_iter().map(|(from, to)| Mask {
            from,
            to,
            joints: joints.clone(),
        }));
    }
    masks.sort();
}
