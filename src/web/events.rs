//! Server-sent events: which version of a study's data and fits is current. A page fetches what changed.

use std::{convert::Infallible, time::Duration};

use axum::response::sse::{Event, KeepAlive, Sse};
use serde::Serialize;
use tokio::sync::broadcast::error::RecvError;
use tokio_stream::Stream;
use tokio_util::sync::CancellationToken;

use crate::{
    jobs::Version,
    store::{Error, Population, Store},
    study::StudyId,
};
