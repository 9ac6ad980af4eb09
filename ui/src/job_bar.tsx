// What long work looks like while it goes on: a bar, the time that is left, a way to stop.

import { cancelJob, isRunning } from "./jobs";
import type { JobView } from "./protocol";

/** 75 -> "1:15". */
export function minutes(secs: number): string {
  const s = Math.max(0, Math.round(secs));
  return s >= 3600
    ? `${Math.floor(s / 3600)}:${String(Math.floor(s / 60) % 60).padStart(2, "0")}:${String(s % 60).padStart(2, "0")}`
    : `${Math.floor(s / 60)}:${String(s % 60).padStart(2, "0")}`;
}

/** Time that is left, seconds; undefined before it can be told. */
export function left(job: JobView): number | undefined {
  const p = job.progress;
  if (!p || p.done <= 0 || p.total <= 0 || p.secs < 0.5) return undefined;
  return (p.secs * (p.total - p.done)) / p.done;
}

export function JobBar({ job }: { job: JobView }) {
  const p = job.progress;
  const share = job.phase === "done" ? 1 : p && p.total > 0 ? Math.min(1, p.done / p.total) : 0;
  const eta = left(job);
  return (
    <div class="job-bar">
      <progress value={share} max={1} aria-label={`${job.title || job.kind}, ${Math.round(share * 100)} %`} />
      <span class="num">{Math.round(share * 100)} %</span>
      <span class="grow">
        {job.phase === "running"
          ? p
            ? `${p.what} ${p.done.toLocaleString("en")} of ${p.total.toLocaleString("en")} ${p.unit}${eta === undefined ? "" : `, ${minutes(eta)} left`}`
            : "starting…"
          : job.phase === "cancelling"
            ? "stopping…"
            : job.phase}
      </span>
      {isRunning(job) ? (
        <button onClick={() => void cancelJob(job.id)} data-testid={`cancel-${job.id}`}>
          {job.phase === "cancelling" ? "Stop now" : "Cancel"}
        </button>
      ) : null}
    </div>
  );
}
