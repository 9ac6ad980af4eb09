//! Training: schedules, curriculum, the loop, resuming.
