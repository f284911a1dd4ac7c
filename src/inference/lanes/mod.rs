//! Arithmetic on many positions at once.
//!
//! A density is evaluated at `W` positions together: every quantity is an array of `W` lanes, and every step a loop over
//! them without branches, which the compiler turns into vector instructions. [`InstructionSet::run`] compiles such a loop
//! for each set and picks the widest one when the program runs, so no compiler flag is needed.
//!
//! Sums and products are never fused and never reordered, and exp, ln, sine and cosine are polynomials of this module:
//! so lanes hold the same bits with every instruction set and for every `W`. The price is a rounding, and on processors
//! that do not add and multiply in separate units some time; it has not been measured.

mod elementary;
mod random;

pub use elementary::{exp, ln, ln_1p_of_share};
pub use random::{LaneRandom, fill_normals};

use pulp::NullaryFnOnce;

/// Lanes of a set of chains: one chain each.
pub const LANES: usize = 8;

/// The vector instructions that a loop is compiled for.
#[derive(Debug, Clone, Copy)]
pub enum InstructionSet {
    /// What every processor of the target has.
    Baseline,
    /// AVX2: four lanes a register.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
    /// AVX-512: eight lanes a register.
    #[cfg(target_arch = "x86_64")]
    Avx512(pulp::x86::V4),
}

/// A loop over lanes. Everything it calls must be `#[inline(always)]`, or it is compiled for the baseline.
pub trait Kernel {
    /// What it computes.
    type Output;

    /// Does it.
    fn run(self) -> Self::Output;
}

struct Call<K>(K);

impl<K: Kernel> NullaryFnOnce for Call<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.0.run()
    }
}

impl InstructionSet {
    /// All that this processor has, the widest first.
    pub fn available() -> Vec<Self> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            sets.extend(pulp::x86::V4::try_new().map(Self::Avx512));
            sets.extend(pulp::x86::V3::try_new().map(Self::Avx2));
        }
        sets.push(Self::Baseline);
        sets
    }

    /// The widest that this processor has.
    pub fn widest() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(token) = pulp::x86::V4::try_new() {
                return Self::Avx512(token);
            }
            if let Some(token) = pulp::x86::V3::try_new() {
                return Self::Avx2(token);
            }
        }
        Self::Baseline
    }

    /// Runs a loop with these instructions.
    #[inline(always)]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Baseline => kernel.run(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(token) => token.vectorize(Call(kernel)),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(token) => token.vectorize(Call(kernel)),
        }
    }
}
