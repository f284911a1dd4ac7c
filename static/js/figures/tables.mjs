import { meanSd } from "./accuracy.mjs";
import { count, decimal, percent } from "./format.mjs";
import { modelName } from "./palette.mjs";

const stateWords = {
  converged: "converged",
  running: "running",
  unconverged: "not converged yet",
  failed: "failed",
  waiting: "waiting",
};

/** Tables that stand by themselves on the results page, by the name in `data-table`. */
export const tables = {
  checks: {
    needs: ["summary"],
    build({ summary }) {
      const baseline = summary.checks?.baseline;
      if (!baseline) return null;
      const label = (id) => summary.actions.find((action) => action.id === id)?.label ?? id;
      const columns = [
        { label: "Problem" },
        { label: "Better action" },
        { label: "n", numeric: true },
        { label: "Chose it", numeric: true },
        { label: "95 % Wilson", numeric: true },
      ];
      const rows = baseline.problems.map((problem) => [
        problem.label,
        label(problem.optimal),
        count(problem.n),
        percent(problem.share),
        interval(problem),
      ]);
      rows.push(["Together", "", count(baseline.n), percent(baseline.share), interval(baseline)]);
      return { columns, rows };
    },
  },

  pooled: {
    needs: ["accuracy"],
    build({ accuracy }) {
      const columns = [
        { label: "Cells" },
        { label: "From" },
        { label: "Risk-Aware", numeric: true },
        { label: "Noisy Rational", numeric: true },
        { label: "Paired t", numeric: true },
        { label: "Welch t", numeric: true },
        { label: "Cells left out", numeric: true },
      ];
      const rows = accuracy.pooled.flatMap((row) => {
        const ours = [
          row.label,
          "these answers",
          meanSd(row.models.risk_aware),
          meanSd(row.models.noisy_rational),
          test(row.paired_t),
          test(row.welch_t),
          count(row.left_out),
        ];
        const published = accuracy.paper?.find((candidate) => candidate.label === row.label);
        if (!published) return [ours];
        const paper = [
          row.label,
          "the paper",
          meanSd(published.risk_aware, 1),
          meanSd(published.noisy_rational, 1),
          published.t === null || published.t === undefined ? "–" : `t(${published.df}) = ${decimal(published.t)}, p ${sign(published.p)}`,
          "–",
          "–",
        ];
        return [ours, paper];
      });
      return { columns, rows };
    },
  },

  fits: {
    needs: ["summary"],
    build({ summary }) {
      const plans = new Map(summary.plans.map((plan) => [plan.id, plan.label]));
      const columns = [
        { label: "Fit" },
        { label: "Part" },
        { label: "Model" },
        { label: "State" },
        { label: "largest R̂", numeric: true },
        { label: "smallest ESS", numeric: true },
        { label: "Draws", numeric: true },
        { label: "Seed", numeric: true },
        { label: "Message", wraps: true },
      ];
      const rows = summary.fits.map((fit) => [
        plans.get(fit.plan) ?? fit.plan,
        fit.part,
        modelName(summary, fit.model),
        { text: `${stateWords[fit.state] ?? fit.state}${fit.provisional ? ", provisional" : ""}`, state: fit.state },
        decimal(fit.rhat_max, 3),
        fit.ess_min === null ? "–" : count(Math.round(fit.ess_min)),
        count(fit.draws),
        fit.seed === null ? "–" : String(fit.seed),
        fit.message ?? "",
      ]);
      return { columns, rows };
    },
  },
};

function interval({ low, high }) {
  return low === null || low === undefined ? "–" : `${percent(low)} to ${percent(high)}`;
}

function test(result) {
  if (!result || result.t === null) return "–";
  const df = Number.isInteger(result.df) ? result.df : decimal(result.df, 1);
  const p = result.p < 0.001 ? "< .001" : `= ${result.p.toFixed(3).replace(/^0/, "")}`;
  return `t(${df}) = ${decimal(result.t)}, p ${p}`;
}

function sign(p) {
  const text = String(p);
  return /^[<>=]/.test(text) ? text : `= ${text}`;
}
