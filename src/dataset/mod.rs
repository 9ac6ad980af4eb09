//! Trajectories on disk: shards, manifest, windows.
