//! From a clip to a simulated motion: windows, policies, precision.
