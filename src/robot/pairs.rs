//! The number of pairs of geoms that the simulator may have to test for contact, which bounds the
//! time of a step: 15 million pairs that overlap take a second.

use std::collections::BTreeMap;

use robert_mujoco::{Model, index};

/// Geoms by their contact bits, `contype` and `conaffinity`.
type Kinds = BTreeMap<(i32, i32), usize>;

/// Pairs of geoms whose bits match, on bodies that can move against each other and are not parent and
/// child. Excluded pairs of bodies are counted, too.
pub(super) fn count(model: &Model) -> usize {
    let (mut all, mut bodies) = (Kinds::new(), BTreeMap::<usize, Kinds>::new());
    for geom in 0..model.ngeom() {
        let kind = (model.geom_contype()[geom], model.geom_conaffinity()[geom]);
        let body = index(model.body_weldid()[index(model.geom_bodyid()[geom])]);
        *all.entry(kind).or_default() += 1;
        *bodies.entry(body).or_default().entry(kind).or_default() += 1;
    }
    let mut pairs = within(&all);
    for (&body, kinds) in &bodies {
        pairs -= within(kinds);
        let parent = index(model.body_weldid()[index(model.body_parentid()[body])]);
        // What is fixed to the world collides with its children.
        if parent != 0
            && let Some(above) = bodies.get(&parent)
        {
            pairs -= across(kinds, above);
        }
    }
    pairs
}

fn across(a: &Kinds, b: &Kinds) -> usize {
    let collide = |x: &(i32, i32), y: &(i32, i32)| x.0 & y.1 != 0 || y.0 & x.1 != 0;
    let with = |x: &(i32, i32)| b.iter().filter(|y| collide(x, y.0)).map(|y| y.1).sum::<usize>();
    a.iter().map(|(x, n)| n * with(x)).sum()
}

fn within(kinds: &Kinds) -> usize {
    // Every pair is counted from both sides, and each geom that matches itself once.
    let own: usize = kinds.iter().filter(|(k, _)| k.0 & k.1 != 0).map(|(_, n)| n).sum();
    (across(kinds, kinds) - own) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_those_that_touch_when_all_overlap() {
        let geoms = |n: usize, bits: &str| format!("<geom size='.1' {bits}/>").repeat(n);
        let joint = "<joint axis='0 0 1'/>";
        let (plain, seen) = (geoms(3, ""), geoms(5, "contype='0' conaffinity='0'"));
        let (one, two) =
            (geoms(2, "contype='2' conaffinity='1'"), geoms(4, "contype='1' conaffinity='0'"));
        let xml = format!(
            "<mujoco><size nconmax='500' njmax='3000'/><worldbody>{plain}<body>{joint}{plain}{seen}<body>{joint}{plain}<body>{two}</body><body>{joint}{one}</body></body></body>\
             <body>{joint}{plain}{two}</body></worldbody></mujoco>"
        );
        let model = std::sync::Arc::new(Model::from_xml(&xml).unwrap());
        let mut data = robert_mujoco::Data::new(&model).unwrap();
        data.forward().unwrap();
        assert_eq!(count(&model), data.contacts().count());
        assert!(count(&model) > 50);
    }
}
