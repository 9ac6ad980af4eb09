//! The policies that are available for a robot.

use super::guide::Guide;
use super::policy_name::PolicyName;
use super::shipped;
use robert_net::{Card, MaskGranularity, SkipKind};
use robert_robot::Robot;

/// A policy that is available for a robot.
#[derive(
    Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
pub struct Offer {
    /// The policy's name.
    pub name: PolicyName,
    /// Name of the model, if it is not the robot's default one.
    pub model: Option<String>,
    /// Cases in which it is best, in a few words.
    pub suits: String,
    /// The guide that should fill masked frames for it.
    pub guide: Guide,
    /// What is missing before it can be chosen; `None` if nothing is.
    pub needs: Option<String>,
    /// Whether it computes with the robot's model.
    pub knows_model: bool,
    /// Whether it needs seconds for a clip.
    pub slow: bool,
    /// The masks that it accepts: for a learned policy those it was trained with, for all others
    /// any.
    pub masks: MaskGranularity,
    /// Whether it is the robot's default.
    pub default: bool,
}

/// All policies for a robot, including models. All pages and tables use this list.
pub fn offers(robot: &Robot) -> Vec<Offer> {
    let offer = |name: PolicyName| Offer {
        name,
        model: None,
        suits: name.suits().to_owned(),
        guide: Guide::None,
        knows_model: matches!(
            name,
            PolicyName::Auto
                | PolicyName::ComputedTorque
                | PolicyName::AdaptiveComputedTorque
                | PolicyName::Ilqr
                | PolicyName::PredictiveSampling
        ),
        slow: matches!(name, PolicyName::Ilqr | PolicyName::PredictiveSampling),
        needs: None,
        masks: MaskGranularity::Joint,
        default: name == PolicyName::Auto,
    };
    let mut list = Vec::new();
    for name in PolicyName::all() {
        if !name.needs_model() {
            list.push(offer(name));
            continue;
        }
        match shipped::get(robot, shipped::DEFAULT) {
            Ok(Some(model)) => {
                let masks = model.card.masks();
                // A network's file need not contain the linear prediction.
                let lacks = name == PolicyName::Ridge && model.encoder.ridge.is_none();
                let needs = match name {
                    PolicyName::Nearest => Some("recorded motion: name the dataset"),
                    PolicyName::MlpInverse => Some("a fit: name its file or dataset"),
                    _ => lacks.then_some("a model with a linear prediction in it"),
                };
                let needs = needs.map(str::to_owned);
                let (suits, guide) = match name {
                    PolicyName::Robert => case(&model.card),
                    _ => (name.suits(), Guide::None),
                };
                let suits = suits.to_owned();
                list.push(Offer { suits, guide, needs, masks, ..offer(name) });
            }
            Ok(None) => {
                let needs = Some(format!(
                    "there is no built-in model for {}: train one, or name its file",
                    robot.id()
                ));
                list.push(Offer { needs, ..offer(name) });
            }
            Err(e) => list.push(Offer { needs: Some(e.to_string()), ..offer(name) }),
        }
    }
    for name in shipped::of(robot).into_iter().filter(|n| n != shipped::DEFAULT) {
        let Ok(Some(model)) = shipped::get(robot, &name) else { continue };
        let masks = model.card.masks();
        let (suits, guide) = case(&model.card);
        let suits = suits.to_owned();
        let named = Offer { model: Some(name), suits, guide, masks, ..offer(PolicyName::Robert) };
        list.push(Offer { default: false, ..named });
    }
    list
}

/// Cases in which a trained network is best, and the guide that should fill masked frames for it;
/// measured in `docs/models.md`.
pub fn case(card: &Card) -> (&'static str, Guide) {
    if card.tokens.previous_action {
        // Small steps reveal the plant, and the guide divides wide gaps into small steps.
        let suits = "an unknown payload, damping or motor strength; turns the guide on";
        (suits, Guide::Linear)
    } else if card.net.skip == SkipKind::Off {
        ("comparison: the network as in the paper, without the linear prediction", Guide::None)
    } else {
        (PolicyName::Robert.suits(), Guide::None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_sees_the_past_wants_the_guide() {
        let offers = offers(&Robot::builtin("pointmass").unwrap());
        let guided = offers.iter().filter(|o| o.guide == Guide::Linear);
        let models: Vec<_> = guided.map(|o| o.model.as_deref()).collect();
        assert_eq!(models, [Some("adaptive")]);
        assert!(offers.iter().any(|o| o.default && o.guide == Guide::None));
    }
}
