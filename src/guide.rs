//! The guide: what the command does and what its numbers mean, a chapter a topic. For the library begin with the [front page](crate).

#[doc = include_str!("guide/numbers.md")]
pub mod numbers {}

#[doc = include_str!("guide/config.md")]
pub mod config {}

#[doc = include_str!("guide/solids.md")]
pub mod solids {}

#[doc = include_str!("guide/corners.md")]
pub mod corners {}

#[doc = include_str!("guide/commands.md")]
pub mod commands {}

#[doc = include_str!("guide/results.md")]
pub mod results {}

#[doc = include_str!("guide/sweeps.md")]
pub mod sweeps {}

#[doc = include_str!("guide/python.md")]
pub mod python {}

#[doc = include_str!("guide/closed_form.md")]
pub mod closed_form {}

#[doc = include_str!("guide/method.md")]
pub mod method {}

#[doc = include_str!("guide/limits.md")]
pub mod limits {}
