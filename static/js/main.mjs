/**
 * Starts one class for each name in each `data-module` (several names are separated by spaces).
 * A module that fails to load or to start is reported alone: the page works without it.
 */

const loaders = {
  trial: async () => (await import("./trial.mjs")).Trial,
  countdown: async () => (await import("./countdown.mjs")).Countdown,
  pending: async () => (await import("./pending.mjs")).Pending,
  sweeps: async () => (await import("./sweeps.mjs")).Sweeps,
  watch: async () => (await import("./watch.mjs")).Watch,
  live: async () => (await import("./live.mjs")).Live,
  replays: async () => (await import("./replays.mjs")).Replays,
};

async function start(element, name) {
  try {
    const Module = await loaders[name]();
    new Module(element);
  } catch (error) {
    console.error(`module "${name}" did not start`, error);
  }
}

for (const element of document.querySelectorAll("[data-module]")) {
  for (const name of element.dataset.module.split(/\s+/).filter(Boolean)) {
    if (Object.hasOwn(loaders, name)) start(element, name);
    else console.error(`unknown module "${name}"`);
  }
}
