"use strict";
// Asks for the newest view four times a second and shows it. Nothing else is asked of the sensor, and nothing from elsewhere.

const find = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const PERIOD_MS = 250;
const HIDDEN_PERIOD_MS = 2000;
const ANNOUNCE_AFTER_MS = 1000;
const STATES = {
  self_test: "testing itself", interlocked: "waiting for the reset button", arming: "arming: looking at the dark floor",
  running: "watching", stopped: "stopped", lockout: "locked: service is needed", "": "the safety controller is not heard",
};
const RELAYS = { closed: "The robot may move", open: "The robot must stand", unknown: "Not known" };

let about = null;
let shownPicture = 0;
let announced = "";
let announcing = null;

function set(id, text) {
  const element = find(id);
  if (element.textContent !== text) element.textContent = text;
}

function shape(name, attributes, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

function cell(row, text, kind) {
  const element = document.createElement("td");
  element.textContent = text;
  if (kind) element.className = kind;
  row.append(element);
  return element;
}

const millimetres = (value, digits = 1) => (value === null ? "none" : `${value.toFixed(digits)} mm`);

// Told once it has stood for a second: a relay that chatters does not make the page chatter.
function announce(text) {
  if (text === announced) return;
  announced = text;
  clearTimeout(announcing);
  announcing = setTimeout(() => set("announcement", text), ANNOUNCE_AFTER_MS);
}

function showState(status) {
  find("state").dataset.relay = status.relay;
  set("relay", RELAYS[status.relay]);
  const words = STATES[status.state] ?? status.state;
  set("state-words", `Safety controller: ${words}`);
  const causes = status.relay === "closed" ? status.warnings : [...status.live, ...status.latched.filter(
    (latched) => !status.live.some((live) => live.name === latched.name)).map(
    (latched) => ({ ...latched, words: `${latched.words} (until the reset)` }))];
  const list = find("causes");
  const told = causes.map((cause) => cause.words);
  if (list.dataset.told !== told.join("|")) {
    list.dataset.told = told.join("|");
    list.replaceChildren(...told.map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
  }
  announce(`${RELAYS[status.relay]}. ${told.join(". ")}`);
}

function path(points) {
  let text = "";
  let pen = false;
  for (const point of points) {
    if (point === null) { pen = false; continue; }
    text += `${pen ? "L" : "M"}${point[0].toFixed(1)} ${point[1].toFixed(1)}`;
    pen = true;
  }
  return text;
}

function showProfile(profile, status) {
  const picture = find("profile");
  const count = profile.place_mm.length;
  if (count === 0) return;
  const first = Math.min(profile.place_mm[0], profile.place_mm[count - 1]);
  const last = Math.max(profile.place_mm[0], profile.place_mm[count - 1]);
  const top = Math.max(60, ...profile.height_mm.filter((height) => height !== null).map((height) => height * 1.15));
  const x = (place) => ((place - first) / (last - first)) * 800;
  const y = (height) => 205 - (Math.max(-20, height) / top) * 190;
  const parts = [];
  for (const zone of about?.zones ?? []) {
    const now = status.zones.find((one) => one.name === zone.name);
    const kind = now ? `zone ${now.role} ${now.finding}` : "zone";
    parts.push(shape("rect", { class: kind, x: x(zone.start_mm), y: 0, width: x(zone.end_mm) - x(zone.start_mm), height: 240 }));
  }
  parts.push(shape("path", { class: "grid", d: `M0 ${y(0)}H800` }));
  parts.push(shape("path", { class: "limit", d: `M0 ${y(50)}H800` }));
  const width = 800 / count;
  profile.height_mm.forEach((height, index) => {
    if (height === null) parts.push(shape("rect", { class: "gap", x: x(profile.place_mm[index]) - width / 2, y: 0, width, height: 240 }));
  });
  const all = profile.height_mm.map((height, index) => (height === null ? null : [x(profile.place_mm[index]), y(height)]));
  parts.push(shape("path", { class: "trace", d: path(all) }));
  const asked = window.commission?.place ?? null;
  if (asked !== null) parts.push(shape("path", { class: "asked", d: `M${x(asked)} 0V240` }));
  const raised = all.map((point, index) => (point && Math.abs(profile.height_mm[index]) > 3 ? point : null));
  parts.push(shape("path", { class: "raised", d: path(raised) }));
  picture.replaceChildren(...parts);
  const gap = status.longest_gap_mm === 0 ? "whole" : `longest gap ${millimetres(status.longest_gap_mm)}`;
  const high = status.highest_mm === null ? "nothing raised" : `highest point ${millimetres(status.highest_mm)}`;
  set("profile-words", `${first.toFixed(0)} to ${last.toFixed(0)} mm along the stripe: ${gap}, ${high}. Dashed: 50 mm.`);
}

const FINDINGS = { free: "free", suspect: "something narrow", infringed: "something is there" };
const ROLES = { named: "only named", warning: "warning field", protective: "protective field" };

function showZones(status) {
  const list = find("zones");
  list.hidden = status.zones.length === 0;
  const rows = status.zones.map((zone) => ({ ...zone, text: `${zone.name}, ${ROLES[zone.role]}: ${FINDINGS[zone.finding]}` }));
  const told = rows.map((row) => row.text).join("|");
  if (list.dataset.told !== told) {
    list.dataset.told = told;
    list.replaceChildren(...rows.map((row) => {
      const item = document.createElement("li");
      item.className = `${row.role} ${row.finding}`;
      item.textContent = row.text;
      return item;
    }));
  }
  find("case-words").hidden = about.cases === 0;
  const speed = status.speed_mm_s === null ? "The robot's speed is not known" : `The robot's speed: ${status.speed_mm_s.toFixed(0)} mm/s`;
  const chosen = status.case === null ? "all cases are in force together" : `case ${status.case} of ${about.cases} is in force`;
  set("case-words", `${speed}; ${chosen}.`);
}

function showPicture(live) {
  const { number, width, height } = live.picture;
  if (number === 0) return;
  find("picture-frame").hidden = false;
  if (number !== shownPicture) {
    shownPicture = number;
    find("picture").src = `/picture.jpg?${number}`;
  }
  const overlay = find("overlay");
  overlay.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const points = live.profile.row.map((row, index) => (row === null ? null : [live.profile.column[index], row]));
  const parts = [shape("path", { class: "stripe", d: path(points) })];
  for (const object of live.objects) {
    const [left, upper, right, lower] = object.pixels;
    parts.push(shape("rect", { class: "object", x: left, y: upper, width: right - left, height: lower - upper }));
  }
  overlay.replaceChildren(...parts);
  const seen = live.objects.map((object) => `${object.category} (${(object.confidence * 100).toFixed(0)} %)`);
  const third = live.tier_three === null ? "" : live.tier_three ? ` Tier 3 sees: ${seen.join(", ") || "nothing"}.` : " Tier 3 does not know.";
  set("picture-words", `Blue: where the stripe is found.${third}`);
}

function showStops(stops) {
  const body = find("stops");
  const newest = stops.length ? stops[0].number : 0;
  if (body.dataset.newest === String(newest)) return;
  body.dataset.newest = String(newest);
  find("no-stops").hidden = stops.length > 0;
  find("stops-region").hidden = stops.length === 0;
  find("replay-words").hidden = !stops.some((stop) => stop.recording);
  body.replaceChildren(...stops.map((stop) => {
    const row = document.createElement("tr");
    cell(row, new Date(stop.unix_ms).toLocaleTimeString());
    cell(row, stop.causes.map((cause) => cause.words).join("; ") || "not told");
    cell(row, millimetres(stop.longest_gap_mm), "number");
    cell(row, millimetres(stop.highest_mm), "number");
    const last = cell(row, "");
    if (stop.recording) {
      const link = document.createElement("a");
      link.href = `/recordings/${encodeURIComponent(stop.recording)}`;
      link.textContent = "fetch";
      link.setAttribute("aria-label", `Fetch the recording of stop ${stop.number}`);
      last.append(link);
    }
    return row;
  }));
}

const ADVICE = { run_over: "drive over it, slower", go_around: "stop, then go around", stop_and_warn: "stop, warn and wait" };

function showFigures(status) {
  const { counts, latency, recording } = status;
  const [age, longest, bound] = status.decision_age_ms;
  const recorded = !recording.wanted ? "off" : recording.problem ? `stopped: ${recording.problem}`
    : `${(recording.written / 1048576).toFixed(1)} MiB${recording.dropped ? `, ${recording.dropped} events lost` : ""}`;
  const rows = [
    ["Host, picture to status: half, 99 %, longest", `${latency.p50_ms.toFixed(1)}, ${latency.p99_ms.toFixed(1)}, ${latency.longest_ms.toFixed(1)} ms`],
    ["Light to decision: last, longest, bound", `${age.toFixed(0)}, ${longest.toFixed(0)}, ${bound.toFixed(0)} ms`],
    ["Permitted speed", `${status.permitted_speed_percent} %`],
    ["Advice to the robot", ADVICE[status.advice] ?? "drive on"],
    ["Pictures, missing", `${counts.pictures}, ${counts.missing}`],
    ["Line-scans accepted, refused, lost", `${counts.accepted}, ${counts.refused}, ${counts.lost}`],
    ["Camera opened again", `${counts.restarts}`],
    ["Stops", `${counts.stops}`],
    ["Recording", recorded],
  ];
  const list = find("figures");
  const text = JSON.stringify(rows);
  if (list.dataset.told === text) return;
  list.dataset.told = text;
  list.replaceChildren(...rows.flatMap(([name, value]) => {
    const term = document.createElement("dt");
    const description = document.createElement("dd");
    term.textContent = name;
    description.textContent = value;
    return [term, description];
  }));
}

function showAbout() {
  set("module", about.module);
  document.title = `nearfield ${about.module}`;
  find("response").replaceChildren(...about.response.map((part) => {
    const row = document.createElement("tr");
    cell(row, part.name);
    cell(row, `${part.typical_ms.toFixed(1)} ms`, "number");
    cell(row, `${part.worst_ms.toFixed(1)} ms`, "number");
    return row;
  }));
  set("response-words", `Narrow things are voted on: ${about.vote_ms.toFixed(0)} ms more, ${about.response_worst_ms.toFixed(0)} ms at worst.`
    + ` The robot needs ${about.stopping_distance_mm.toFixed(0)} mm and has ${about.distance_mm.toFixed(0)} mm:`
    + ` at most ${about.permitted_speed_mm_s.toFixed(0)} mm/s.`);
  find("remark-section").hidden = !about.takes_remarks;
  showCapability(about.capability);
}

function showCapability(places) {
  find("capability-section").hidden = places.length === 0;
  if (places.length === 0) return;
  const widths = places.filter((place) => place.width_mm !== null).map((place) => place.width_mm);
  const top = Math.max(10, ...widths);
  const step = 800 / places.length;
  find("capability").replaceChildren(...places.map((place, index) => {
    const seen = place.width_mm !== null;
    const height = seen ? (place.width_mm / top) * 150 : 160;
    return shape("rect", { class: seen ? "bar" : "gap", x: index * step, y: 160 - height, width: step * 0.8, height });
  }));
  const blind = places.length - widths.length;
  set("capability-words", `Widths from ${millimetres(Math.min(...widths))} to ${millimetres(Math.max(...widths))} are surely seen.`
    + (blind ? ` At ${blind} of ${places.length} places nothing is.` : ""));
}

async function ask(where) {
  const answer = await fetch(where, { cache: "no-store" });
  if (!answer.ok) throw new Error(`${answer.status}`);
  return answer.json();
}

async function turn() {
  try {
    if (about === null) {
      about = await ask("/api/about");
      showAbout();
    }
    const live = await ask("/api/live");
    set("connection", "live");
    showState(live.status);
    showProfile(live.profile, live.status);
    showZones(live.status);
    showPicture(live);
    showStops(live.stops);
    showFigures(live.status);
  } catch {
    set("connection", "no connection to the sensor");
    find("state").dataset.relay = "unknown";
    set("relay", RELAYS.unknown);
    set("state-words", "What is shown below is old.");
    announce("No connection to the sensor");
  }
  setTimeout(turn, document.hidden ? HIDDEN_PERIOD_MS : PERIOD_MS);
}

find("remark-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  set("remark-answer", "");
  const headers = { Authorization: `Bearer ${find("token").value}` };
  try {
    const answer = await fetch("/api/mark", { method: "POST", headers, body: find("remark").value });
    set("remark-answer", answer.ok ? "It is in the recording." : await answer.text());
    if (answer.ok) find("remark").value = "";
  } catch {
    set("remark-answer", "No connection to the sensor.");
  }
});

turn();
