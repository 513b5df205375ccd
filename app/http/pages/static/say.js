// Helpers that every page shares: screen reader messages, waiting, copying text, file pickers.

export const $ = (id) => document.getElementById(id);

export function fill(text, facts) {
  return text.replace(/\{(\w+)\}/g, (_, name) => facts[name] ?? "…");
}

export function say(text) {
  const place = $("status");
  if (!place) return;
  place.textContent = "";
  setTimeout(() => (place.textContent = text), 50); // delayed, so that the same text is announced twice
}

// Wait, but only until the network is back.
export function pause(milliseconds) {
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
    window.prompt(button.textContent, button.dataset.copy); // if the clipboard needs https
  }
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("[data-copy], [data-opens]");
  if (button?.dataset.opens) $(button.dataset.opens).click();
  else if (button) copy(button);
});
