//! Ways for a document to come to the desk.

use std::path::Path;

use super::super::document::Document;
use super::super::error::Error;
use super::super::protocol::DocumentView;
use super::super::shelf;
use super::super::worker::{Report, Request, RobotFacts};
use super::{Desk, ROBOT_PATIENCE, reference};
use crate::clip::{self, Clip, JointTable};
use crate::robot::MODEL_FILE;

/// What the simulation said of a clip's robot.
pub(super) type Asked = Result<RobotFacts, Error>;

/// What is known of the joints then.
fn table(asked: &Asked) -> Option<JointTable> {
    asked.as_ref().ok().map(|facts| facts.table.clone())
}

impl Desk {
    pub(super) fn open(&mut self, path: &Path) -> Result<DocumentView, Error> {
        // The same file again: give its lock back first, but keep the document if it fails.
        let again = std::path::absolute(path).ok();
        if self.document.as_ref().is_some_and(|d| d.path() == again.as_deref()) {
            return Ok(self.view());
        }
        let mut asked = None;
        let document = Document::open(path, &self.state_dir, |clip| {
            table(asked.insert(self.ask_robot(clip)))
        })?;
        Ok(self.take_up(document, asked))
    }

    pub(super) fn recover(&mut self) -> bool {
        let mut asked = None;
        let mut ask = |clip: &Clip| table(asked.insert(self.ask_robot(clip)));
        let mut found = Document::orphan(&self.state_dir, &mut ask);
        for file in self.recent.list() {
            if found.is_some() {
                break;
            }
            match Document::left_open(file.path.as_ref(), &self.state_dir, &mut ask) {
                Ok(document) => found = document,
                Err(e) => tracing::warn!("{} is not taken up: {e}", file.path),
            }
        }
        let Some(mut document) = found else { return false };
        // Should it be what ended that studio, the next start does without it.
        document.put_aside();
        self.take_up(document, asked);
        if let Some(document) = &mut self.document {
            document.taken_up();
        }
        true
    }

    pub(super) fn take_up_draft(&mut self, number: u32) -> Result<DocumentView, Error> {
        let mut asked = None;
        let document = Document::draft(&self.state_dir, number, |clip| {
            table(asked.insert(self.ask_robot(clip)))
        })?;
        Ok(self.take_up(document, asked))
    }

    pub(super) fn start_from(&mut self, clip: Clip) -> Result<DocumentView, Error> {
        let asked = self.ask_robot(&clip);
        let document = Document::new(clip, &self.state_dir, table(&asked))?;
        Ok(self.take_up(document, Some(asked)))
    }

    /// Asks about a robot and remembers where it comes from.
    pub(super) fn know(&mut self, robot: &str) -> Result<RobotFacts, Error> {
        let request = Request::Facts { robot: robot.to_owned() };
        match self.worker.ask_blocking(request, ROBOT_PATIENCE)? {
            Report::Facts(facts) => {
                self.sources.insert(facts.id.clone(), robot.to_owned());
                Ok(*facts)
            }
            _ => Err(Error::request("the simulation gave no facts")),
        }
    }

    /// Asks the worker to take a clip's robot up: by its id, or from the folder that the
    /// user named, that the clip names, or that an import left beside us.
    pub(super) fn ask_robot(&self, clip: &Clip) -> Result<RobotFacts, Error> {
        let id = &clip.robot.id;
        let named = clip.robot.model.as_ref().map(|m| self.folder.join(m));
        let named = named.filter(|dir| dir.join(MODEL_FILE).is_file());
        let robot = match (self.sources.get(id), named) {
            (Some(source), _) => source.clone(),
            (None, Some(dir)) if !shelf::is_builtin(id) => dir.display().to_string(),
            _ => shelf::source(id, &self.folder, &self.state_dir).unwrap_or_else(|| id.clone()),
        };
        match self.worker.ask_blocking(Request::Robot { robot }, ROBOT_PATIENCE)? {
            Report::Facts(facts) => Ok(*facts),
            _ => Err(Error::request("the simulation gave no facts")),
        }
    }

    pub(super) fn blank(
        &mut self,
        robot: &str,
        length: u32,
        name: String,
    ) -> Result<DocumentView, Error> {
        let facts = self.know(robot)?;
        let table = &facts.table;
        let mut clip = Clip::new(reference(table), length.clamp(2, crate::limits::CLIP_FRAMES));
        clip.name = name;
        // The first key is where the robot starts, until somebody says another start.
        let rest: Vec<f64> = table.rest.iter().map(|v| clip::round(*v)).collect();
        clip.keys.push(clip::Key::new(0, &rest));
        self.start_from(clip)
    }
}
