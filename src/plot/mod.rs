//! Charts in one house style, as PNG and SVG.
