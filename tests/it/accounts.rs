//! Accounts, sessions, tokens: who may do what, with which status, and what the log says of it.

mod commands;
mod lab;
mod log;
mod people;
mod public;
mod rights;
mod routes;
mod sessions;
mod streams;
