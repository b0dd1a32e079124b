// The address of the page, #review?session=a&trial=1: whatever a view shows is found again from it.

/** Name of the view and values of the address. */
export function address() {
  const [view, values] = location.hash.slice(1).split("?");
  return { view: view || "sessions", values: new URLSearchParams(values || "") };
}

/** The address of a view with values. */
export const link = (view, values) => `#${view}?${new URLSearchParams(values)}`;

/** Keep values in the address without drawing anew, so that a reload comes back to the same place. */
export function remember(values) {
  const { view, values: old } = address();
  for (const [key, value] of Object.entries(values)) {
    if (value === null || value === undefined || value === "") old.delete(key); else old.set(key, value);
  }
  history.replaceState(null, "", link(view, old));
}
