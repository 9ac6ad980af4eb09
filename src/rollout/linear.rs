//! `ridge`: the linear prediction inside a model file. It sees only the window, and its own past actions.

use std::sync::Arc;

use super::error::Error;
use super::model_frames::Frames;
use super::policy::{Policy, View};
use super::window::Window;
use robert_net::observer::{self, SEEN};
use robert_net::{self as net, ActionHistory, CURRENT, Encoder, HISTORY, Observer};

/// The linear prediction alone, without a network; fitted in seconds.
#[derive(Clone, Debug)]
pub struct Linear {
    encoder: Arc<Encoder>,
    frames: Frames,
    scratch: net::token::Scratch,
    features: Vec<f32>,
    answer: Vec<f32>,
    /// The actions of the last frames, oldest first, (at most 30, A), if the prediction is scaled by
    /// what they reveal.
    past: Option<Vec<f32>>,
    observer: Option<Observer>,
    card: Option<String>,
}

impl Linear {
    /// The linear prediction inside a model.
    ///
    /// # Errors
    /// [`Error::Needs`] when the model has none.
    pub fn new(encoder: Encoder) -> Result<Self, Error> {
        if encoder.ridge.is_none() {
            return Err(Error::Needs {
                policy: "ridge".to_owned(),
                needs: "a model with a linear skip; this one was trained without".to_owned(),
            });
        }
        Ok(Linear {
            frames: Frames::new(&encoder, None),
            scratch: encoder.tokens.scratch(),
            features: Vec::new(),
            answer: vec![0.0; encoder.tokens.facts().actions],
            encoder: Arc::new(encoder),
            past: None,
            observer: None,
            card: None,
        })
    }

    /// Adds the card of its model, and the observer that it names.
    #[must_use]
    pub fn with_card(self, card: &net::Card) -> Self {
        let frames = Frames::new(&self.encoder, card.reach.as_ref());
        let observer = Observer::new(card.observer, self.answer.len());
        Linear { card: serde_json::to_string_pretty(card).ok(), frames, observer, ..self }
    }

    /// Adds the disturbance that past motion shows to each action; the newest frame counts `percent`
    /// in it, and 0 is off. `None` is what the card says.
    ///
    /// # Errors
    /// [`Error::Model`] if `percent` is above 100, or the observed frame has too few frames before it.
    pub fn with_observer(self, percent: Option<u8>) -> Result<Self, Error> {
        let Some(percent) = percent else { return Ok(self) };
        observer::check(percent, self.encoder.tokens.config())?;
        let observer = Observer::new(percent, self.answer.len());
        Ok(Linear { observer, ..self })
    }

    /// Scales each actuator's prediction by the ratio of applied to predicted actions over the last
    /// 30 frames, which reveals a robot that is heavier, more damped or weaker than those of the fit.
    #[must_use]
    pub fn with_gain(self, gain: bool) -> Self {
        Linear { past: gain.then(Vec::new), ..self }
    }

    /// The action for this window, (A).
    pub fn answer(&mut self, window: &Window, action: &mut [f64]) {
        debug_assert_eq!(window.history.len(), HISTORY * window.dim());
        self.frames.fill(window);
        let (tokens, now) = (&self.encoder.tokens, CURRENT..CURRENT + 1);
        tokens.read(&self.frames.q, &self.frames.visible, &mut self.scratch);
        let gain = self.gain();
        let Some(ridge) = &self.encoder.ridge else {
            unreachable!("a linear policy is made from an encoder with a linear prediction")
        };
        let tokens = &self.encoder.tokens;
        ridge.answers(tokens, &self.scratch, now, &mut self.features, &mut self.answer);
        for (j, (to, &x)) in action.iter_mut().zip(&self.answer).enumerate() {
            let gain = gain.as_ref().map_or(1.0, |g| 1.0 + g.gain()[j]);
            *to = f64::from((gain * x).clamp(-1.0, 1.0));
        }
        self.observe(gain.as_ref(), action);
        self.remember(action);
    }

    /// Adds the disturbance that the window which was just read reveals to `action`, (A).
    fn observe(&mut self, gain: Option<&ActionHistory>, action: &mut [f64]) {
        let (Some(observer), Some(ridge)) = (&mut self.observer, &self.encoder.ridge) else {
            return;
        };
        let (tokens, seen) = (&self.encoder.tokens, SEEN..SEEN + 1);
        ridge.answers(tokens, &self.scratch, seen, &mut self.features, &mut self.answer);
        if let Some(gain) = gain {
            self.answer.iter_mut().zip(gain.gain()).for_each(|(x, g)| *x *= 1.0 + g);
        }
        let mut sum: Vec<f32> = action.iter().map(|&x| x as f32).collect();
        observer.correct(&self.answer, &mut sum);
        action.iter_mut().zip(&sum).for_each(|(to, &x)| *to = f64::from(x));
    }

    /// What the past of the window that was just read reveals.
    fn gain(&mut self) -> Option<ActionHistory> {
        let (past, ridge) = (self.past.as_ref()?, self.encoder.ridge.as_ref()?);
        let tokens = &self.encoder.tokens;
        let actions = tokens.facts().actions;
        let mut history = ActionHistory::new(actions);
        // The oldest frames of the window have no past from which to predict.
        let back = tokens.config().ridge_history;
        let first = (CURRENT - past.len() / actions).max(back);
        let past = &past[past.len() - (CURRENT - first) * actions..];
        let mut predicted = vec![0.0; past.len()];
        ridge.answers(tokens, &self.scratch, first..CURRENT, &mut self.features, &mut predicted);
        for (applied, predicted) in past.chunks(actions).zip(predicted.chunks(actions)) {
            history.see(applied, predicted);
        }
        Some(history)
    }

    /// Adds an applied action to the past.
    fn remember(&mut self, action: &[f64]) {
        if let Some(past) = &mut self.past {
            let most = HISTORY * action.len();
            past.extend(action.iter().map(|&x| x as f32));
            past.drain(..past.len().saturating_sub(most));
        }
        if let Some(observer) = &mut self.observer {
            observer.remember(action.iter().map(|&x| x as f32));
        }
    }
}

impl Policy for Linear {
    fn name(&self) -> String {
        "ridge".to_owned()
    }

    fn sees_plan(&self) -> bool {
        self.frames.sees_plan()
    }

    fn card(&self) -> Option<String> {
        self.card.clone()
    }

    fn reset(&mut self, _seed: u64) {
        self.past.iter_mut().for_each(Vec::clear);
        if let Some(observer) = &mut self.observer {
            observer.reset();
        }
    }

    fn fork(&self) -> Option<Box<dyn Policy>> {
        Some(Box::new(self.clone()))
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.answer(view.window, action);
        Ok(())
    }

    fn applied(&mut self, action: &[f64]) {
        let narrow = || action.iter().map(|&x| x as f32);
        if let Some(past) = &mut self.past {
            past.truncate(past.len().saturating_sub(action.len()));
            past.extend(narrow());
        }
        if let Some(observer) = &mut self.observer {
            observer.replace(narrow());
        }
    }

    fn memory(&self) -> Vec<f64> {
        let past = self.past.iter().flatten().map(|&x| f64::from(x));
        let Some(observer) = &self.observer else { return past.collect() };
        let seen: Vec<f64> = observer.memory().collect();
        std::iter::once(seen.len() as f64).chain(seen).chain(past).collect()
    }

    fn recall(&mut self, memory: &[f64]) {
        let mut rest = memory;
        if let (Some(observer), Some((&seen, all))) = (&mut self.observer, memory.split_first()) {
            let (seen, past) = all.split_at(seen as usize);
            observer.recall(seen);
            rest = past;
        }
        if let Some(past) = &mut self.past {
            past.clear();
            past.extend(rest.iter().map(|&x| x as f32));
        }
    }
}
