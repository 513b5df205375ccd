// Small things that every page shares: telling a screen reader, waiting, copying a text, opening a chooser of
// files.

export const $ = (id) => document.getElementById(id);

export function fill(text, facts) {
  return text.replace(/\{(\w+)\}/g, (_, name) => facts[name] ?? "…");
}

export function say(text) {
  const place = $("status");
  if (!place) return;
  place.textContent = "";
  setTimeout(() => (place.textContent = text), 50); // so that the same text is told twice
}

// Wait, but no longer than until the network is back.
export function rest(milliseconds) {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, milliseconds);
    window.addEventListener("online", () => (clearTimeout(timer), resolve()), { once: true });
  });
}

export async function copy(button) {
  try {
    await navigator.clipboard.writeText(button.dataset.copy);
    button.textContent = button.dataset.done;
    say(button.dataset.done);
  } catch {
    window.prompt(button.textContent, button.dataset.copy); // where the clipboard needs https
  }
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("[data-copy], [data-opens]");
  if (button?.dataset.opens) $(button.dataset.opens).click();
  else if (button) copy(button);
});
