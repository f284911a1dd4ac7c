//! The commands of the `riskaware` binary.
