//! Mesh and surface files: round trips, files of other programs, files read by other programs, and bad files.

mod damage;
mod dialects;
mod faults;
mod fixtures;
mod python;
mod round_trips;
mod vtu;
