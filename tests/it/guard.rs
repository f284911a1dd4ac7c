//! What the guard before all routes does against those who mean harm: limits, proxies, credentials that ended, and the log.

mod credentials;
mod lab;
mod limits;
mod log;
mod strangers;
mod wire;
