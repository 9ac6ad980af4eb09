//! Requests on the socket that are not edits.

use std::sync::Arc;

use super::answer::apart;
use crate::protocol::{Error, Outcome, StudioOp};
use crate::session::SessionCommand;
use crate::simulation::Takes;
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
        StudioOp::TakePin { id, pinned } => takes(app, move |t| t.pin(id, pinned)).await?,
        StudioOp::TakeName { id, name } => takes(app, move |t| t.name(id, &name)).await?,
        StudioOp::TakeCompare { ids } => takes(app, move |t| t.compare(&ids)).await?,
        StudioOp::TakeRemove { id } => takes(app, move |t| t.remove(id)).await?,
        view => app.viewport.tell(view).await?,
    }
    Ok(Outcome::Done)
}

/// Changes the takes, of which the pinned ones are files.
async fn takes(
    app: &App,
    change: impl FnOnce(&mut Takes) -> Result<(), Error> + Send + 'static,
) -> Result<(), Error> {
    let rollout = Arc::clone(&app.simulation.rollout);
    apart("the takes were not changed", move || rollout.change_takes(change)).await?
}
