// The views and the address of the page, #review?session=a&trial=1: whatever a view shows is found again from it.

/** Views by their name in the address, with their titles, in the order of the list at the top. */
export const VIEWS = { sessions: "Sessions", live: "Live", review: "Review", outlines: "Outlines", action: "Action" };

/** View and values of the address; the first view where it names none. */
export function address() {
  const [view, values] = location.hash.slice(1).split("?");
  return { view: view in VIEWS ? view : "sessions", values: new URLSearchParams(values || "") };
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
