// Both builds are plain scripts that leave a global; d3 must be there before Plot looks for it.
import "../../vendor/d3/d3.min.js";
import "../../vendor/plot/plot.umd.min.js";

export const Plot = globalThis.Plot;
export const d3 = globalThis.d3;
