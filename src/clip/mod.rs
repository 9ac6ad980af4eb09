//! The animation document: keyframes, masks and what can be done to them.
