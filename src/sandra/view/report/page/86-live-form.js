// The form of the live page: what is asked, and where it is sent.

class Live {
  constructor(told) {
    this.token = told.live.token;
    this.offer = told.live.offer;
    this.follows = told.live.follows;
  }

  async fetch(path, body) {
    const answer = await fetch(path, {
      method: body === undefined ? "GET" : "POST",
      headers: {
        "X-Sandra-Token": this.token,
        ...(body === undefined ? {} : { "Content-Type": "application/json" }),
      },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
    const text = await answer.text();
    let data = null;
    try {
      data = JSON.parse(text);
    } catch {
      throw new Error(
        answer.ok
          ? "The answer cannot be read."
          : `The server says: ${text.slice(0, 300)} (${answer.status}). There is no verdict.`,
      );
    }
    if (!answer.ok) throw new Error(data.error || `Error ${answer.status}`);
    return data;
  }
}

const choice = (name, text, options, value) =>
  field(
    name,
    text,
    el(
      "select",
      { name, id: `ask-${name}` },
      options.map((option) => el("option", { value: option, selected: option === value }, option)),
    ),
  );

const field = (name, text, input, hint) =>
  el(
    "div",
    { class: `field field-${name}` },
    el("label", { for: `ask-${name}` }, text),
    input,
    hint && el("p", { class: "faint small", id: `hint-${name}` }, hint),
  );

function askForm(live, submit) {
  const { offer } = live;
  const error = el("p", { role: "alert", class: "error" });
  const button = el("button", { type: "submit", class: "primary" }, "Decide");
  const line = (name, text, placeholder, list) =>
    field(
      name,
      text,
      el("input", {
        type: "text",
        name,
        id: `ask-${name}`,
        placeholder,
        list,
        maxlength: 2000,
        autocomplete: "off",
        spellcheck: "false",
      }),
    );
  const actions = Object.entries(offer.actions).map(([name, text]) =>
    el(
      "div",
      { class: "field" },
      el("label", { for: `act-${name}` }, name),
      el("input", {
        type: "text",
        id: `act-${name}`,
        "data-action": name,
        value: text,
        maxlength: 2000,
        autocomplete: "off",
        spellcheck: "false",
        class: "mono",
      }),
    ),
  );
  const limits = offer.limits.map((limit) =>
    el(
      "div",
      { class: "field" },
      el(
        "label",
        { for: `limit-${limit.name}` },
        limit.text,
        el("span", { class: "faint" }, ` [${limit.unit}]`),
      ),
      el("input", {
        type: "number",
        step: "any",
        id: `limit-${limit.name}`,
        "data-limit": limit.name,
        value: limit.value,
        required: true,
      }),
    ),
  );
  const form = el(
    "form",
    { id: "live-form", class: "card", "aria-labelledby": "ask-title", novalidate: true },
    el("h2", { id: "ask-title" }, "Ask"),
    el(
      "div",
      { class: "fields" },
      choice("scenario", "Scenario", offer.scenarios, offer.first),
      choice("ranker", "Ranker", offer.rankers, offer.rankers[0]),
      line("command", "Command, in your own words", "none"),
      choice("prediction", "Prediction of the others", offer.predictions, offer.predictions[0]),
      field(
        "horizon",
        "Horizon [steps]",
        el("input", {
          type: "number",
          name: "horizon",
          id: "ask-horizon",
          min: 1,
          max: offer.longest_horizon,
          step: 1,
          value: offer.horizon,
          required: true,
        }),
      ),
      choice("mode", "Mode", offer.modes, offer.modes[0]),
      line(
        "rules",
        "Rules: names or formulas, commas between",
        "R_G1, R_G2, R_G3, G(v <= 8.3)",
        "known-rules",
      ),
    ),
    el(
      "datalist",
      { id: "known-rules" },
      [Object.keys(offer.rules).join(", "), ...Object.keys(offer.rules)].map((value) =>
        el("option", { value }),
      ),
    ),
    fold(
      "Formulas of the actions",
      el(
        "p",
        { class: "faint small" },
        "LTL over finite traces: G always, F eventually, X next, U until; & | ! ->",
      ),
      el("div", { class: "fields" }, actions),
    ),
    fold("Limits", el("div", { class: "fields" }, limits)),
    el("div", { class: "ask-row" }, button, el("button", { type: "reset" }, "As at first"), error),
  );
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    error.textContent = "";
    button.disabled = true;
    button.textContent = "Deciding …";
    try {
      await submit(questionIn(form, offer));
      say("Decided.");
    } catch (problem) {
      error.textContent = problem.message;
    } finally {
      button.disabled = false;
      button.textContent = "Decide";
    }
  });
  return form;
}

// What is filled in; a number that is none is an error in words.
function questionIn(form, offer) {
  const value = (name) => form.elements[name].value;
  const whole = (input, text) => {
    const found = Number(input.value);
    if (input.value.trim() === "" || !Number.isFinite(found))
      throw new Error(`${text}: write a number.`);
    return found;
  };
  const horizon = whole(form.elements.horizon, "Horizon");
  if (!Number.isInteger(horizon)) throw new Error("Horizon: write a whole number of steps.");
  const question = { horizon, actions: {}, limits: {} };
  for (const name of ["scenario", "ranker", "command", "prediction", "mode", "rules"])
    question[name] = value(name);
  for (const input of form.querySelectorAll("[data-action]")) {
    const name = input.dataset.action;
    if (input.value !== offer.actions[name]) question.actions[name] = input.value;
  }
  for (const limit of offer.limits) {
    const input = form.querySelector(`#limit-${limit.name}`);
    const found = whole(input, limit.text);
    if (found !== limit.value) question.limits[limit.name] = found;
  }
  return question;
}
