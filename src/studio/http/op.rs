//! Requests on the socket that are not edits.

use crate::protocol::{Error, Outcome, StudioOp};
use crate::session::SessionCommand;
use crate::state::App;

/// Performs a request on the socket that is not an edit, and returns its answer.
///
/// # Errors
/// Whatever it says.
pub(crate) async fn studio_op(app: &App, op: StudioOp) -> Result<Outcome, Error> {
    match op {
        StudioOp::Undo {} | StudioOp::Redo {} | StudioOp::HistoryGoto { .. } => {}
        StudioOp::Preview { op } => {
            let demand = app.session.ask(|r| SessionCommand::Preview(op, r)).await?;
            return Ok(Outcome::Previewed { demand });
        }
        StudioOp::PreviewEnd {} => app.session.ask(SessionCommand::PreviewEnd).await?,
        StudioOp::RolloutSet(settings) => {
            app.session.ask(|r| SessionCommand::Settings(settings, r)).await?;
        }
        StudioOp::RolloutRun {} => app.session.ask(SessionCommand::Run).await?,
        StudioOp::RolloutCancel {} => app.simulation.cancel(),
        StudioOp::WorkerRestart {} => app.simulation.restart(),
        StudioOp::TakePin { id, pinned } => {
            app.simulation.rollout.change_takes(|t| t.pin(id, pinned))?;
        }
        StudioOp::TakeName { id, name } => {
            app.simulation.rollout.change_takes(|t| t.name(id, &name))?;
        }
        StudioOp::TakeCompare { ids } => {
            app.simulation.rollout.change_takes(|t| t.compare(&ids))?;
        }
        StudioOp::TakeRemove { id } => app.simulation.rollout.change_takes(|t| t.remove(id))?,
        view => app.viewport.tell(view).await?,
    }
    Ok(Outcome::Done)
}
