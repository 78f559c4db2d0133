"use strict";
// The commissioning: shows how far it is to everybody, and begins and ends it for who knows the token. It watches; relays are closed by
// the reset button at the robot.

(() => {
  const element = (id) => document.getElementById(id);
  const PERIOD_MS = 500;
  const STANDINGS = { next: "not yet", now: "now", passed: "passed", failed: "NOT passed" };
  let told = "";
  let running = false;

  function item(text, kind) {
    const one = document.createElement("li");
    one.textContent = text;
    if (kind) one.className = kind;
    return one;
  }

  function step(view) {
    const one = document.createElement("li");
    const standing = document.createElement("span");
    standing.className = `standing ${view.standing}`;
    standing.textContent = STANDINGS[view.standing];
    one.append(`${view.title}: `, standing);
    if (view.standing === "now") one.setAttribute("aria-current", "step");
    const list = document.createElement("ul");
    for (const check of view.checks) {
      const waits = view.standing === "now" && check.found === "not tried";
      list.append(item(`${check.name}: ${check.found} (demanded: ${check.demanded})`, check.passed || waits ? "" : "failed"));
    }
    if (view.checks.length) one.append(list);
    return one;
  }

  function show(view) {
    running = view.running;
    window.commission = { place: view.place_mm };
    const text = JSON.stringify(view);
    if (text === told) return;
    told = text;
    element("commission-section").classList.toggle("running", view.running);
    const end = view.passed === null ? "" : view.passed ? "All was as demanded. " : "NOT passed: the robot must not be released. ";
    const words = end + view.instruction;
    if (element("commission-instruction").textContent !== words) element("commission-instruction").textContent = words;
    element("commission-steps").replaceChildren(...view.steps.map(step));
    element("commission-protocol").hidden = !view.has_protocol;
    element("commission-button").textContent = view.running ? "End" : view.has_protocol ? "Begin anew" : "Begin";
    element("commission-person").disabled = view.running;
  }

  async function turn() {
    try {
      const answer = await fetch("/api/commission", { cache: "no-store" });
      if (answer.ok) {
        element("commission-section").hidden = false;
        // The page's own turn has asked what this sensor takes.
        element("commission-form").hidden = !(about?.takes_orders ?? false);
        show(await answer.json());
      }
    } catch {
      // The page says that there is no connection.
    }
    setTimeout(turn, running ? PERIOD_MS : 4 * PERIOD_MS);
  }

  element("commission-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    element("commission-answer").textContent = "";
    const headers = { Authorization: `Bearer ${element("commission-token").value}` };
    const where = running ? "/api/commission/end" : "/api/commission/begin";
    const body = running ? "" : element("commission-person").value;
    try {
      const answer = await fetch(where, { method: "POST", headers, body });
      if (!answer.ok) element("commission-answer").textContent = await answer.text();
    } catch {
      element("commission-answer").textContent = "No connection to the sensor.";
    }
  });

  turn();
})();
