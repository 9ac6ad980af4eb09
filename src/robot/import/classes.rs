//! Values that an MJCF's default classes give its elements.

use std::collections::BTreeMap;

use roxmltree::{Document, Node};

/// The default classes of a document.
pub(super) struct Classes<'a, 'd> {
    /// The outermost sections in the order of the file. Together they are the main class.
    tops: Vec<Node<'a, 'd>>,
    /// The classes inside of them by name.
    inner: BTreeMap<&'a str, Node<'a, 'd>>,
}

impl<'a, 'd> Classes<'a, 'd> {
    pub(super) fn of(doc: &'a Document<'d>) -> Self {
        let is_default = |n: &Node<'a, 'd>| n.has_tag_name("default");
        let tops: Vec<_> = doc.root_element().children().filter(is_default).collect();
        let inside = tops.iter().flat_map(|top| top.descendants().skip(1).filter(is_default));
        let inner = inside.filter_map(|n| Some((n.attribute("class")?, n))).collect();
        Classes { tops, inner }
    }

    /// An attribute of an element: its own value, or else that of its class or of an enclosing
    /// class. `tags` are the class elements that may give it (all actuators share one default).
    pub(super) fn get(
        &self,
        node: Node<'a, 'd>,
        tags: &[&str],
        attribute: &str,
    ) -> Option<&'a str> {
        if let Some(own) = node.attribute(attribute) {
            return Some(own);
        }
        let inherited = || node.ancestors().skip(1).find_map(|a| a.attribute("childclass"));
        let class = node.attribute("class").or_else(inherited);
        let class = class.and_then(|name| self.inner.get(name)).copied();
        let is_default = |n: &Node<'a, 'd>| n.has_tag_name("default");
        let chain = class.into_iter().flat_map(|c| c.ancestors().filter(is_default));
        // A class begins as a copy of the one around it, so later outermost sections do not count for it.
        let within = |top: &Node<'a, 'd>| class.is_none_or(|c| top.range().start < c.range().start);
        let main = self.tops.iter().rev().copied().filter(within);
        chain.chain(main).find_map(|class| {
            let given = |n: &Node<'a, 'd>| tags.iter().any(|t| n.has_tag_name(*t));
            class.children().filter(given).filter_map(|n| n.attribute(attribute)).next_back()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_word_counts() {
        let xml = r#"<mujoco><default><position kv="1"/><joint damping="3"/><default class="a"><general kv="2"/>
            <default class="b"><joint damping="4"/></default></default></default>
            <worldbody><body childclass="b"><joint name="x"/><body><joint name="y" class="a"/><joint name="z" damping="5"/></body></body></worldbody>
            <actuator><position name="p"/><position name="q" class="b"/></actuator></mujoco>"#;
        let doc = Document::parse(xml).unwrap();
        let classes = Classes::of(&doc);
        let get = |name: &str, tags: &[&str], attribute: &str| {
            let node = doc.descendants().find(|n| n.attribute("name") == Some(name)).unwrap();
            classes.get(node, tags, attribute)
        };
        assert_eq!(get("x", &["joint"], "damping"), Some("4"));
        assert_eq!(get("y", &["joint"], "damping"), Some("3"));
        assert_eq!(get("z", &["joint"], "damping"), Some("5"));
        assert_eq!(get("p", &["position", "general"], "kv"), Some("1"));
        assert_eq!(get("q", &["position", "general"], "kv"), Some("2"));
        assert_eq!(get("q", &["position"], "kp"), None);
    }

    #[test]
    fn outermost_sections_count_together() {
        let xml = r#"<mujoco><default><joint axis="1 0 0" damping="1"/></default>
            <default class="main"><joint damping="2"/><default class="a"><joint armature="5"/></default></default>
            <default><joint damping="3"/></default>
            <worldbody><body><joint name="x"/><joint name="y" class="a"/><joint name="z" class="main"/></body></worldbody></mujoco>"#;
        let doc = Document::parse(xml).unwrap();
        let classes = Classes::of(&doc);
        let get = |name: &str, attribute: &str| {
            let node = doc.descendants().find(|n| n.attribute("name") == Some(name)).unwrap();
            classes.get(node, &["joint"], attribute).unwrap_or("none")
        };
        for (name, axis, damping, armature) in
            [("x", "1 0 0", "3", "none"), ("y", "1 0 0", "2", "5"), ("z", "1 0 0", "3", "none")]
        {
            let got = ["axis", "damping", "armature"].map(|a| get(name, a));
            assert_eq!(got, [axis, damping, armature], "{name}");
        }
    }
}
