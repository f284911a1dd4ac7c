/**
 * One form that is being sent, kept for this tab so that it survives a reload.
 * @typedef {{action: string, body: string}} PendingForm
 */

const slot = "riskaware.pending";

/** @param {PendingForm} form */
export function keep(form) {
  try {
    sessionStorage.setItem(slot, JSON.stringify(form));
  } catch {
    // Storage can be switched off or full: the form is then kept by this page alone.
  }
}

/** @returns {PendingForm | null} */
export function kept() {
  try {
    const form = JSON.parse(sessionStorage.getItem(slot));
    return typeof form?.action === "string" && typeof form.body === "string" ? form : null;
  } catch {
    return null;
  }
}

export function forget() {
  try {
    sessionStorage.removeItem(slot);
  } catch {
    // Nothing was kept.
  }
}
