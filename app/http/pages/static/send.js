// Send forms without leaving the page, and show a refusal next to the typed values.

// go(address): follow the answer; by default to its page.
export async function send(form, button, { busy, lost, refused }, go = (address) => location.assign(address)) {
  const text = button.textContent;
  [button.disabled, button.textContent] = [true, busy];
  try {
    const to = button.getAttribute("formaction") || form.action;
    const answer = await fetch(to, { method: "POST", body: new URLSearchParams(new FormData(form)) });
    if (answer.ok) return form.dispatchEvent(new Event("sent")), go(answer.url);
    refuse(refused, await answer.text());
    form.dispatchEvent(new Event("refused"));
    lost.hidden = true;
  } catch {
    lost.hidden = false;
  }
  [button.disabled, button.textContent] = [false, text];
}

// The server responds with a page; show its problem.
export function refuse(box, page) {
  const said = new DOMParser().parseFromString(page, "text/html").querySelector("[data-problem]");
  const parts = said ? [...document.importNode(said, true).children] : [];
  box.replaceChildren(...parts.filter((part) => !part.matches("[data-page]")));
  const heading = box.querySelector("h1");
  heading?.replaceWith(Object.assign(document.createElement("p"), { className: "problem-title", textContent: heading.textContent }));
  box.hidden = false;
  box.scrollIntoView({ block: "nearest" });
}
