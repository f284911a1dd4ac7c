import { count, moment } from "./format.mjs";

/** The line below a figure: n, models, plan, draws, seed, versions, time; what is unknown is left out. */
export function caption(figure, data, plan) {
  const { summary } = data;
  const source = figure.needs.includes("accuracy") ? data.accuracy : figure.needs.includes("curves") ? data.curves : null;
  const parts = [];
  if (summary.simulated) parts.push("Simulated data");
  parts.push(`n = ${count(summary.answers.counted)} answers of ${count(summary.people.completed)} people who finished`);
  if (plan) parts.push(`fit: ${planLabel(summary, plan)}`);
  if (isProvisional(source)) parts.push("provisional");
  if (source?.draws) parts.push(`${count(source.draws)} draws`);
  if (source?.samples) parts.push(`${source.samples} spaced draws`);
  if (source?.seed !== undefined && source?.seed !== null) parts.push(`seed ${source.seed}`);
  parts.push(`data version ${(source ?? summary).data_version}, fit version ${(source ?? summary).fit_version}`);
  const time = (source ?? summary).at ?? data.fetchedAt;
  if (time) parts.push(moment(time));
  return parts.join(" · ");
}

/** Whether one of the fits that are drawn depends on the fits before it. */
function isProvisional(source) {
  return source?.plans?.some((part) => Object.values(part.models).some((fit) => fit.provisional)) ?? false;
}

export function planLabel(summary, plan) {
  return summary.plans.find((candidate) => candidate.id === plan)?.label ?? plan;
}
