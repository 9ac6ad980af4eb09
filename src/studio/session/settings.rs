//! The settings for rollouts of the open document.

use super::actor::SessionActor;
use crate::protocol::{Event, RolloutSettings};
use robert_clip::Granularity;
use robert_net::MaskGranularity;
use robert_net::checkpoint::read_card;
use robert_rollout::{Guide, Offer, PolicyName, model_path};

impl SessionActor {
    /// Performs so from now on.
    pub(super) fn settle_on(&mut self, settings: RolloutSettings) {
        self.choice.granularity = match self.masks(&settings) {
            MaskGranularity::State => Granularity::State,
            MaskGranularity::Joint => Granularity::Joint,
        };
        self.simulation.set_settings(settings.clone());
        self.hub.send(&Event::RolloutSettings(settings));
    }

    pub(super) fn offers(&self) -> Vec<Offer> {
        self.simulation.robot().map(|r| r.offers.clone()).unwrap_or_default()
    }

    /// The masks that the policy of these settings accepts. A model file that cannot be read is
    /// ignored here; the error is reported when the policy performs.
    pub(super) fn masks(&self, settings: &RolloutSettings) -> MaskGranularity {
        let offers = self.offers();
        let offered =
            offers.iter().find(|o| o.name == settings.policy && o.model == settings.model_path);
        match (offered, &settings.model_path) {
            (Some(offer), _) => offer.masks,
            (None, Some(path)) if settings.policy.needs_model() => {
                let card = read_card(&model_path(&self.workspace.folder.join(path)));
                card.map_or(MaskGranularity::Joint, |c| c.masks())
            }
            _ => MaskGranularity::Joint,
        }
    }

    /// The settings for the document that is being opened: the chosen ones as far as its robot
    /// supports them, and the guide that the policy needs.
    pub(super) fn suited(&self, robot: &str) -> RolloutSettings {
        let mut settings = self.simulation.rollout.settings();
        let offers = self.offers();
        if let Some(path) = &settings.model_path {
            let named = offers.iter().any(|o| o.model.as_ref() == Some(path));
            let file = model_path(&self.workspace.folder.join(path));
            // Other kinds of fit have no card; whether they match the robot is found when they are
            // loaded.
            let other = || !file.exists() || read_card(&file).is_ok_and(|c| c.robot.id != robot);
            if !named && other() {
                settings.model_path = None;
            }
        }
        let known = offers.iter().find(|o| o.name == settings.policy && o.model.is_none());
        let has = settings.model_path.is_some() || known.is_some_and(|o| o.needs.is_none());
        if (!self.choice.by_hand && settings.model_path.is_none()) || !has {
            let default = offers.iter().find(|o| o.default).map(|o| o.name);
            settings.policy = default.unwrap_or(PolicyName::ComputedTorque);
        }
        // A guide set by hand was for the gaps of the clip before.
        let offer =
            offers.iter().find(|o| o.name == settings.policy && o.model == settings.model_path);
        settings.guide = offer.map_or(Guide::None, |o| o.guide);
        settings
    }
}
