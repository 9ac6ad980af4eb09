//! Values that an MJCF's default classes give its elements.

use std::collections::BTreeMap;

use roxmltree::{Document, Node};

/// The default classes of a document.
pub(super) struct Classes<'a, 'd> {
    /// Class by name; the outermost one is under its name and under "".
    nodes: BTreeMap<&'a str, Node<'a, 'd>>,
}

impl<'a, 'd> Classes<'a, 'd> {
    pub(super) fn of(doc: &'a Document<'d>) -> Self {
        let mut nodes = BTreeMap::new();
        for top in doc.root_element().children().filter(|n| n.has_tag_name("default")) {
            nodes.entry("").or_insert(top);
            for class in top.descendants().filter(|n| n.has_tag_name("default")) {
                nodes.insert(class.attribute("class").unwrap_or("main"), class);
            }
        }
        Classes { nodes }
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
        let name = node.attribute("class").or_else(inherited).unwrap_or("");
        let class = *self.nodes.get(name).or_else(|| self.nodes.get(""))?;
        class.ancestors().filter(|n| n.has_tag_name("default")).find_map(|class| {
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
}
