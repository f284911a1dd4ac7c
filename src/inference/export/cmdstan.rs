//! One chain as CmdStan writes it.

use std::io::{self, Write};

use super::{DrawsExport, Fact};

impl DrawsExport<'_> {
    /// Writes one chain as CmdStan CSV: comments, a header, a line for each draw, comments.
    ///
    /// Columns are `lp__`, the parameters, τ, λθ where it is reported, and `p.1`, `p.2`, … for the options, whose names stand in
    /// the comments. There are no columns of a Hamiltonian sampler (`stepsize__` and the like), for there was none, and
    /// no version of Stan, for it did not take part. What readers require is there: ArviZ (`from_cmdstan`), cmdstanpy
    /// (`from_csv`) and cmdstanr (`read_cmdstan_csv`) need `method`, `model`, `algorithm`, `id` and the numbers of
    /// draws. cmdstanpy takes a file to end in two lines of comments, and refuses a warm-up of 0: it is given as 1, for it
    /// is no number of steps, and none of it is saved.
    ///
    /// * `chain`: counted from 0.
    ///
    /// # Errors
    /// When `out` fails.
    pub fn write_cmdstan_csv(&self, chain: usize, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "# model = {}", self.model_id())?;
        writeln!(out, "# method = sample")?;
        writeln!(out, "#   sample")?;
        writeln!(out, "#     num_samples = {}", self.draws.per_chain)?;
        writeln!(out, "#     num_warmup = 1")?;
        writeln!(out, "#     save_warmup = false")?;
        writeln!(out, "#     thin = 1")?;
        writeln!(out, "#     algorithm = metropolis_hastings")?;
        writeln!(out, "# id = {}", chain + 1)?;
        for (name, fact) in self.facts() {
            match fact {
                Fact::Text(text) => writeln!(out, "# {name} = {text}")?,
                Fact::Whole(number) => writeln!(out, "# {name} = {number}")?,
                Fact::Number(number) => writeln!(out, "# {name} = {number}")?,
            }
        }
        let predicted = self.predicted.as_deref().unwrap_or_default();
        for (index, option) in self.options.iter().enumerate().take(predicted.len()) {
            // As JSON text, so that no name can break the line.
            let name = serde_json::to_string(&option.label())?;
            writeln!(out, "# option_{} = {name}", index + 1)?;
        }

        write!(out, "lp__")?;
        for (quantity, _) in &self.draws.columns {
            write!(out, ",{quantity}")?;
        }
        for index in 1..=predicted.len() {
            write!(out, ",p.{index}")?;
        }
        writeln!(out)?;
        let first = chain * self.draws.per_chain;
        for draw in first..first + self.draws.per_chain {
            write_number(out, self.lp[draw])?;
            let columns = self.draws.columns.iter().map(|(_, values)| values);
            for values in columns.chain(predicted) {
                out.write_all(b",")?;
                write_number(out, values[draw])?;
            }
            writeln!(out)?;
        }
        writeln!(out, "#")?;
        writeln!(out, "# end of chain {}", chain + 1)?;
        Ok(())
    }
}

/// As few digits as lead back to the same number, with an exponent where it is very large or small.
fn write_number(out: &mut dyn Write, number: f64) -> io::Result<()> {
    serde_json::to_writer(out, &number)?;
    Ok(())
}
