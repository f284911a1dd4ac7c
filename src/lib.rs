//! riskaware
