// The conclusion form on a recording's page; its text is kept until it is sent.

import { $ } from "./say.js";
import { send } from "./send.js";
import { Unsent } from "./unsent.js";

const form = $("conclude");

function serialize() {
  const { text, name } = form.elements;
  return JSON.stringify({ text: text.value, name: name?.value });
}

function restore(saved) {
  const { text, name } = JSON.parse(saved);
  form.elements.text.value = text;
  if (form.elements.name && name !== undefined) form.elements.name.value = name;
}

if (form) {
  new Unsent(form, serialize, restore);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const [lost, refused] = ["lost", "refused"].map((name) => form.querySelector(`[data-${name}]`));
    send(form, event.submitter, { busy: form.dataset.busy, lost, refused });
  });
}
