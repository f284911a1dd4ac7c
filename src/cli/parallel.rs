//! Simulations on all processors, with their progress on a terminal.

use std::time::Duration;

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Threads for simulations; one for each processor if no number is given.
pub(super) fn pool(threads: Option<u16>) -> anyhow::Result<ThreadPool> {
    ThreadPoolBuilder::new()
        // 0 stands for the number of processors.
        .num_threads(threads.map_or(0, usize::from))
        .build()
        .context("cannot start threads")
}

/// A bar over this many simulations, which shows itself on a terminal only.
pub(super) fn progress_bar(total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len}, {eta} left: {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(total).with_style(style);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
