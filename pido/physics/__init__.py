"""Textbook formulas as pure functions. Each has its only home here: cutting, friction, drive, thermal, frames."""
