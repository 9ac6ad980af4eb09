//! Policies as people type them.

use std::path::Path;
use std::str::FromStr;

use crate::error::Error;
use crate::guide::Guide;
use crate::inference::Inference;
use crate::policy_config::PolicyConfig;
use crate::policy_name::PolicyName;
use crate::window::COMMAND;

/// The number of windows that contain a frame: as the current frame, and as each command frame.
const WINDOWS: usize = COMMAND + 1;

const OPTIONS: &str = "+guide, +smooth, +refine, +ilc, +sample, +mean, +masks, +gain, +observer=N, +ahead=N or +ensemble=N";

/// The last option with a number: what is before it, its name and its value.
fn number(text: &str) -> Option<(&str, &str, &str)> {
    let (before, value) = text.rsplit_once('=')?;
    ["ahead", "ensemble", "observer"]
        .into_iter()
        .find_map(|option| Some((before.strip_suffix(option)?.strip_suffix('+')?, option, value)))
}

/// Reads `pd`, `pd+guide`, `zero+guide+refine`, `robert:runs/a+ensemble=3+sample+guide`.
impl FromStr for PolicyConfig {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = |why: String| Error::Notation { text: text.to_owned(), why };
        // A path may contain a plus; only these endings are options.
        let (mut rest, mut guide, mut refine, mut ilc) = (text, Guide::None, false, false);
        let mut inference = Inference::default();
        loop {
            if let Some(shorter) = rest.strip_suffix("+guide") {
                (rest, guide) = (shorter, Guide::Linear);
            } else if let Some(shorter) = rest.strip_suffix("+smooth") {
                (rest, guide) = (shorter, Guide::Smooth);
            } else if let Some(shorter) = rest.strip_suffix("+ilc") {
                (rest, ilc) = (shorter, true);
            } else if let Some(shorter) = rest.strip_suffix("+refine") {
                (rest, refine) = (shorter, true);
            } else if let Some(shorter) = rest.strip_suffix("+sample") {
                (rest, inference.sample) = (shorter, true);
            } else if let Some(shorter) = rest.strip_suffix("+mean") {
                (rest, inference.mean) = (shorter, true);
            } else if let Some(shorter) = rest.strip_suffix("+masks") {
                (rest, inference.masks) = (shorter, true);
            } else if let Some(shorter) = rest.strip_suffix("+gain") {
                (rest, inference.gain) = (shorter, true);
            } else if let Some((shorter, "observer", n)) = number(rest) {
                let n = n.parse().ok().filter(|n| (0..=100).contains(n));
                let why = "observer takes 0 to 100 percent; 0 is off";
                inference.observer = Some(n.ok_or_else(|| wrong(why.to_owned()))?);
                rest = shorter;
            } else if let Some((shorter, option, n)) = number(rest) {
                let (slot, most) = match option {
                    "ahead" => (&mut inference.ahead, COMMAND),
                    _ => (&mut inference.ensemble, WINDOWS),
                };
                let n = n.parse().ok().filter(|n| (1..=most).contains(n));
                *slot = n.ok_or_else(|| wrong(format!("{option} takes 1 to {most}")))?;
                rest = shorter;
            } else {
                break;
            }
        }
        let (name, model) = rest.split_once(':').map_or((rest, None), |(n, p)| (n, Some(p)));
        if let (Some((_, other)), None) = (name.split_once('+'), model) {
            return Err(wrong(format!("+{other} is not {OPTIONS}")));
        }
        // If there is no such path, the part after the plus is a misspelt option.
        if let Some(path) = model
            && let Some((_, other)) = path.rsplit_once('+')
            && !other.contains('/')
            && !Path::new(path).exists()
        {
            return Err(wrong(format!("there is no {path}, and +{other} is not {OPTIONS}")));
        }
        let name: PolicyName = name.parse()?;
        if inference.gain && name != PolicyName::Ridge {
            return Err(wrong("+gain is only for ridge".to_owned()));
        }
        let learned = [PolicyName::Robert, PolicyName::Ridge].contains(&name);
        if inference.observer.is_some() && !learned {
            return Err(wrong("+observer=N is only for robert and ridge".to_owned()));
        }
        let own = Inference { gain: false, observer: None, ..inference };
        if own != Inference::default() && name != PolicyName::Robert {
            return Err(wrong(
                "+sample, +mean, +masks, +ahead=N and +ensemble=N are only for robert".to_owned(),
            ));
        }
        if inference.sample && inference.mean {
            return Err(wrong("+sample and +mean exclude each other".to_owned()));
        }
        let model_path = model.map(Into::into);
        Ok(PolicyConfig { guide, refine, ilc, model_path, inference, ..PolicyConfig::new(name) })
    }
}
