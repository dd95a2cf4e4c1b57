// the table of trials and what is beside it; this file owns what is chosen, sorted and filtered
let trials = [], chosen = "", order = { of: "name", down: false }, doing = {}, running = false, audited = {}, waits = 0;
const COLUMNS = [  // title, of a trial, width, class
  { of: "name", title: "Trial", value: t => t.name, width: 190 },
  { of: "state", title: "State", value: t => doing[t.name] || t.status, width: 74 },
  { of: "wrong", title: "What is wrong, worst first", value: t => wrongs(t).join("\n"), weight: t => -wrongs(t).length },
  { of: "measured_percent", title: "Measured", value: t => digits(t.measured_percent, " %", 1), width: 88, number: true },
  { of: "rmse_mm", title: "Gap error", value: t => digits(t.rmse_mm, " mm", 2), width: 80, number: true },
  { of: "fps", title: "Rate", value: t => digits(t.fps, " Hz", 0), width: 70, number: true, slim: true },
  { of: "mirrored", title: "Mirrored", value: t => t.mirrored || "", width: 76, slim: true },
  { of: "edits", title: "Corr.", value: t => t.edits || "", width: 56, number: true, slim: true },
];
// the odd one out of its session says so where no warning does already
// and what was found in files that were checked stands there before they are tracked
const checked = t => t.wrong.length ? [] : (audited[t.name] || []).filter(f => f.alarm).map(f => `${f.kind}: ${f.text}`);
// the row says whose file it is
const bare = t => t.files.reduce((text, file) => text.startsWith(file + ": ") ? text.slice(file.length + 2) : text, t.error);
const wrongs = t => [...t.error ? [bare(t)] : [], ...t.wrong, ...checked(t), ...t.unlike && !t.wrong.includes(t.unlike) ? ["unlike the others: " + t.unlike] : []];
const digits = (x, unit, n) => typeof x === "number" ? x.toFixed(n) + unit : "";
const weight = (column, t) => column.weight ? column.weight(t) : typeof t[column.of] === "number" ? t[column.of] : column.value(t);

async function overview() {
  const all = await get("overview");
  trials = all.trials; commands.trials = all.command; if (document.body.dataset.room === "trials" || !document.body.dataset.room) same("trials"); work = all.out;
  // of what this page shows in another room it has seen what it shows there
  for (const [name, n] of Object.entries(all.seen)) if (![info, drawn].some(one => one && one.trial === name)) seen[name] = n;
  if (!trials.some(t => t.name === chosen)) chosen = trials.length ? trials[0].name : "";
  table(); details(); count("overviews");
  $("track").disabled = all.looking || !trials.length;
  if (all.looking) {
    $("progress").textContent = `looking through the folders for trials ... ${waits++} s`;
    setTimeout(() => queued(overview), 1000);
  } else if (waits || !$("rows").dataset.known) { waits = 0; $("progress").textContent = ""; }
  $("rows").dataset.known = "1";
  return all;
}
// the rows that the filter leaves, in order
function shownTrials() {
  const column = COLUMNS.find(c => c.of === order.of), sign = order.down ? -1 : 1, text = $("filter").value.toLowerCase().replace(/(\d),(?=\d)/g, "$1.");
  const left = trials.filter(t => COLUMNS.some(c => String(c.value(t)).toLowerCase().includes(text)));
  const compare = (a, b) => {
    const [x, y] = [weight(column, a), weight(column, b)], none = v => v === "" || v === null || v === undefined;
    if (none(x) || none(y)) return none(x) - none(y);  // what is not known comes last
    return sign * (typeof x === "number" && typeof y === "number" ? x - y : String(x).localeCompare(String(y), undefined, { numeric: true }));
  };
  return left.sort(compare);
}
function table() {
  const columns = COLUMNS.filter(c => c.of !== "mirrored" || trials.some(t => t.mirrored));
  const look = c => [c.number ? "number" : "", c.slim ? "slim" : ""].filter(Boolean).join(" ");
  $("titles").replaceChildren(...columns.map(c => {
    const th = make("th", "", { className: look(c), scope: "col" }), now = order.of === c.of;
    if (c.width) th.style.width = c.width + "px";
    th.setAttribute("aria-sort", now ? (order.down ? "descending" : "ascending") : "none");
    th.append(make("button", c.title + (now ? (order.down ? " ▾" : " ▴") : ""), { onclick: () => {
      order = { of: c.of, down: now && !order.down }; table(); $("titles").querySelectorAll("button")[columns.indexOf(c)].focus(); } }));
    return th;
  }));
  const rows = shownTrials();
  $("rows").replaceChildren(...rows.map(t => {
    const row = make("tr", "", { className: t.name === chosen ? "now" : "", onclick: () => pickTrial(t.name) });
    row.append(...columns.map(c => {
      const text = String(c.value(t)), cell = make("td", "", { className: look(c), title: text });
      if (c.of === "name") {
        const pick = make("button", shortened(text), { className: "name" });
        pick.setAttribute("aria-current", t.name === chosen ? "true" : "false");
        cell.append(pick);
      } else if (c.of === "wrong") { const [first, ...more] = wrongs(t); cell.classList.add("wrong"); if (first) cell.append(make("span", (more.length ? `${more.length + 1}: ` : "") + first)); }
      else cell.textContent = text;
      if (c.of === "state") cell.classList.add(t.status);
      return cell;
    }));
    return row;
  }));
  $("howmany").textContent = rows.length === trials.length ? `${trials.length} trial${trials.length === 1 ? "" : "s"}` : `${rows.length} of ${trials.length}`;
}
// a long name loses its middle: trials of one day begin alike
function shortened(name) { return name.length > 21 ? name.slice(0, 6) + "…" + name.slice(-12) : name; }
function pickTrial(name) {
  const focused = document.activeElement && document.activeElement.className === "name";
  chosen = name; table(); details(); same("trials", trials.find(t => t.name === name).command);
  if (focused) [...document.querySelectorAll("#rows .name")].find(b => b.closest("tr").className === "now").focus();
}
function details() {
  const t = trials.find(x => x.name === chosen);
  $("details").hidden = !t;
  if (!t) return;
  $("whose").textContent = t.name;
  $("files").textContent = t.files.filter(file => !file.startsWith(t.name + ".")).join(", ");
  const look = make("button", "Check files", { className: "look", onclick: () => queued(() => audit(t)) });
  const bones = make("button", "Skeleton", { className: "bones", onclick: () => queued(() => sketch(t.name)) });
  const proof = make("button", "Proof-read", { className: "read", onclick: () => queued(() => read(t)), disabled: !["done", "changed"].includes(t.status) });
  const skip = make("button", t.status === "skipped" ? "Take in" : "Leave out", { className: "skip", onclick: () => queued(async () => {
    await post("state", t.name, { name: "skip", value: t.status === "skipped" ? "" : "left out by hand" }); await overview(); }) });
  const stops = make("button", "Stop this one", { className: "stop-one", hidden: !running || !(t.name in doing || ["new", "changed"].includes(t.status)),
    onclick: () => queued(async () => { $("said").textContent = (await halt(t.name)).said; }) });
  const kinds = make("select", "", { className: "kinds" });
  kinds.setAttribute("aria-label", "what the result is passed on as");
  for (const [kind, [said]] of Object.entries(t.passes)) kinds.append(make("option", said, { value: kind }));
  kinds.onchange = () => same("trials", t.passes[kinds.value][1]);
  const pass = make("button", "Pass on as", { className: "pass", disabled: t.status !== "done", onclick: () => queued(async () => {
    same("trials", t.passes[kinds.value][1]); $("said").textContent = "writing ...";
    await post("pass", t.name, { kind: kinds.value }); count("passed"); }) });
  $("actions").replaceChildren(look, bones, proof, stops, skip, pass, kinds);
  const found = audited[t.name];
  $("alike").parentElement.hidden = !found || !found.some(f => f.mend.length);
  $("findings").replaceChildren(...found ? found.map(f => finding(t, f)) : wrongs(t).map(text => make("p", text)));
  if (!found && !wrongs(t).length) $("findings").append(make("p", t.status === "new" ? "Not tracked yet." : "Nothing is wrong.", { className: "quiet" }));
}
function finding(t, f) {
  const p = make("p", ""), mark = make("b", (f.open ? "left open, " : "") + f.kind + ": ");
  if (f.alarm) mark.className = "alarm";
  p.append(mark, f.text + " ");
  for (const m of f.mend) {
    const typed = m.value === null && make("input", "", { className: "number", value: m.others || "" });
    if (typed) { typed.setAttribute("aria-label", m.said); p.append(typed, " "); }
    p.append(make("button", m.said, { className: "mend", onclick: () => queued(async () => {
      const value = typed ? decimal(typed.value) : m.value;
      // cameras are in another order in each trial
      const those = $("alike").checked && m.name !== "tracks" ? trials.filter(one => one.status !== "skipped") : [t];
      for (const one of those) await post("state", one.name, { name: m.name, value });
      await overview(); await audit(t);
      if (those.length > 1) $("said").textContent = `stated of ${those.length} trials: ${m.name} ${value}`; }) }));
  }
  return p;
}
// what is found in the files of a trial, worst first, with what can be done
async function audit(t) {
  $("said").textContent = `checking ${t.name} ...`;
  const found = await get("audit?trial=" + encodeURIComponent(t.name)), wrong = found.filter(f => f.alarm).length;
  $("said").textContent = `${t.name}: ${wrong ? wrong + " to be looked at" : "nothing is wrong" + (found.some(f => f.open) ? ", as far as is known" : "")}`;
  audited = { ...audited, [t.name]: found };
  pickTrial(t.name); count("audits");
}
// a trial that cannot be opened, as its corrections are of another recording, is shown with what can be done
async function read(t) {
  try { await open(t.name); } catch (said) { if (!document.body.dataset.ended) { await audit(t); } throw said; }
}
// end what is being tracked, or one trial of it
const halt = trial => get("stop", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(trial ? { trial } : {}) });
async function track() { await post("track", "", {}); follow(); }
function follow() {
  $("stop").disabled = false; $("track").disabled = true;
  queued(async () => {
    const p = await get("progress"), before = $("done").dataset.n;
    $("progress").textContent = p.said || ""; $("done").value = p.total ? p.done / p.total : 0; $("done").dataset.n = p.done || 0;
    doing = p.running ? p.doing || {} : {};
    if (running !== Boolean(p.running)) { running = Boolean(p.running); details(); }
    if (p.running) { if (before !== $("done").dataset.n) await overview(); else table(); setTimeout(follow, 500); return; }
    $("stop").disabled = true; $("track").disabled = false; audited = {}; $("said").textContent = "tracking has ended";
    await overview(); count("tracked");
  });
}
// the row above or below, by keys
function stepTrial(by) {
  const names = shownTrials().map(t => t.name), i = Math.max(0, Math.min(names.length - 1, names.indexOf(chosen) + by));
  if (!names.length) return;
  pickTrial(names[i]);
  const row = document.querySelector("#rows tr.now"); if (row) { row.querySelector(".name").focus(); row.scrollIntoView({ block: "nearest" }); }
}
$("filter").oninput = table;
$("table").onkeydown = e => { const by = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10 }[e.key]; if (by) { e.preventDefault(); stepTrial(by); } };
