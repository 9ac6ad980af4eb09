//! Constraints between sites, which `MuJoCo` 3 knows, as constraints between bodies.
//!
//! `MuJoCo` 2.2.2 ties a point of one body to the point of the other that is at the same place in the
//! default pose. So a `<connect>` of two sites keeps its meaning if both are at one place then, which
//! is checked when the model is compiled.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use roxmltree::{Document, Node};

use super::draft::{Draft, Tie};
use super::loose::is_led;
use crate::text::{Edits, blank, escape};
use crate::{Error, preparse};
use robert_mujoco::{Data, Kind, Model};

/// Two sites that are farther apart in the default pose cannot be tied, m.
const APART: f64 = 1e-3;

/// The text with bodies in place of the sites of every `<connect>`.
///
/// # Errors
/// [`Error::Refused`] for a site that is missing, or whose place is not written as `pos`.
pub(super) fn to_bodies(xml: &str, path: &Path, draft: &mut Draft) -> Result<String, Error> {
    let doc = preparse::parse(xml, path)?;
    let (mut edits, mut count) = (Edits::default(), 0);
    let entries = doc.descendants().filter(|n| n.has_tag_name("connect"));
    for node in entries.filter(|n| n.has_attribute("site1")) {
        let sites = ["site1", "site2"].map(|end| node.attribute(end).unwrap_or_default());
        let [(body1, at), (body2, _)] =
            [place(&doc, node, path, sites[0])?, place(&doc, node, path, sites[1])?];
        let mut text = String::from("<connect");
        for a in node.attributes().filter(|a| !a.name().starts_with("site")) {
            write!(text, " {}=\"{}\"", a.name(), escape(a.value())).ok();
        }
        let ends = [&body1, &body2].map(|body| escape(body));
        write!(text, " body1=\"{}\" body2=\"{}\" anchor=\"{}\"/>", ends[0], ends[1], escape(&at))
            .ok();
        edits.replace(node.range(), text + &blank(xml, node));
        let at = doc.text_pos_at(node.range().start);
        let tie = Tie { sites: sites.map(str::to_owned), line: at.row, column: at.col };
        let active = node.attribute("active") != Some("false");
        draft.ties.extend(
            Some(tie).filter(|_| active && ![body1, body2].iter().any(|b| is_led(&doc, b))),
        );
        count += 1;
    }
    if count > 0 {
        draft.changed.push(format!("{count} ties between sites are between their bodies"));
    }
    Ok(edits.apply(xml))
}

/// The body of a site, and the site's place in it.
fn place(
    doc: &Document<'_>,
    entry: Node<'_, '_>,
    path: &Path,
    name: &str,
) -> Result<(String, String), Error> {
    let is = |n: &Node<'_, '_>| n.has_tag_name("site") && n.attribute("name") == Some(name);
    let Some(site) = doc.descendants().find(is) else {
        let message = format!("<connect> names the site {name:?}, which is not there");
        return Err(preparse::refuse(entry, path, message));
    };
    let is_default = |n: &Node<'_, '_>| {
        n.has_tag_name("site") && n.ancestors().any(|a| a.has_tag_name("default"))
    };
    let elsewhere = !site.has_attribute("pos")
        && doc.descendants().any(|n| is_default(&n) && n.has_attribute("pos"));
    if site.has_attribute("fromto") || elsewhere {
        let message = format!(
            "site {name:?} is tied by a <connect>; give its place as its own pos, not by fromto or a default"
        );
        return Err(preparse::refuse(site, path, message));
    }
    let body = site.parent().filter(|p| p.has_tag_name("body"));
    let body = body.and_then(|p| p.attribute("name")).unwrap_or("world");
    Ok((body.to_owned(), site.attribute("pos").unwrap_or("0 0 0").to_owned()))
}

/// Refuses tied sites that are not at one place in the default pose.
///
/// # Errors
/// [`Error::Refused`].
pub(super) fn check(draft: &Draft, model: &Arc<Model>, path: &Path) -> Result<(), Error> {
    if draft.ties.is_empty() {
        return Ok(());
    }
    let mut data = Data::new(model)?;
    data.kinematics()?;
    let at = |name: &String| {
        let site = model.id(Kind::Site, name)?;
        Some(&data.site_xpos()[3 * site..3 * site + 3])
    };
    for Tie { sites: [a, b], line, column } in &draft.ties {
        // A body that was left out has taken its sites and their ties with it.
        let (Some(from), Some(to)) = (at(a), at(b)) else { continue };
        let apart = from.iter().zip(to).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
        if apart > APART {
            let message = format!(
                "<connect> of sites \"{a}\" and \"{b}\", which are {:.1} mm apart in the default pose; give joints a \
                 default (ref, or pos and quat of the bodies) in which the loop is closed",
                1e3 * apart
            );
            return Err(preparse::refuse_at(&draft.xml, (*line, *column), path, message));
        }
    }
    Ok(())
}
