// The charts and the heat map of a sweep, of the cases that its table shows.
const sweepData = document.getElementById("sweep-data");
// The indices of the cases that are shown; the table tells.
let shownCases = [];
let redrawSweep = () => {};
document.addEventListener("cases-shown", ({ detail }) => {
  shownCases = detail;
  redrawSweep();
});

async function startSweep() {
  const { keys: varied, columns, cases, colours: ramp } = JSON.parse(sweepData.textContent);
  const byId = (id) => document.getElementById(id);
  const scale = ramp.map((colour, at) => [at / (ramp.length - 1), colour]);
  const symbols = ["circle", "square", "diamond", "cross", "triangle-up", "x", "star", "triangle-down"];
  const number = (name) => columns.indexOf(name);
  const value = (one, name) => one.values[number(name)];
  const isNumeric = (name) => cases.every((one) => value(one, name) === null || typeof value(one, name) === "number");
  const isSet = (name) => cases.some((one) => value(one, name) !== null);
  const distinct = (rows, name) => {
    const values = [...new Set(rows.map((one) => value(one, name)))].filter((one) => one !== null);
    return isNumeric(name) ? values.sort((a, b) => a - b) : values;
  };
  const short = (one) => (typeof one === "number" ? String(Number(one.toFixed(5))) : String(one));

  const options = (id, names, chosen) => {
    byId(id).replaceChildren(...names.map((name) => new Option(name || "nothing", name, name === chosen, name === chosen)));
  };
  const known = columns.filter(isSet);
  const numeric = known.filter(isNumeric);
  const several = known.filter((name) => distinct(cases, name).length > 1);
  const firstWords = varied.find((name) => several.includes(name) && !isNumeric(name)) ?? "";
  options("x", known, "max_k");
  options("y", numeric, "mean_k");
  options("colour-by", ["", ...several], firstWords);
  options("facet", ["", ...several.filter((name) => distinct(cases, name).length <= 24)], "");
  const keys = varied.filter((name) => several.includes(name));
  options("heat-rows", keys, keys[0]);
  options("heat-columns", keys, keys[1]);
  options("heat-value", numeric.filter((name) => !varied.includes(name)), "max_k");
  byId("heat").hidden = keys.length < 2;

  function axis(name, rows) {
    if (!isNumeric(name)) {
      const names = distinct(cases, name);
      return { place: (one) => names.indexOf(value(one, name)), layout: { title: { text: name }, automargin: true, tickvals: names.map((_, at) => at), ticktext: names, ticklabeloverflow: "allow", range: [-0.5, names.length - 0.5] } };
    }
    const values = rows.map((one) => value(one, name)).filter((one) => one !== null);
    const [least, most] = [Math.min(...values), Math.max(...values)];
    const logarithmic = least > 0 && most / least > 5;
    const layout = { title: { text: name }, automargin: true, type: logarithmic ? "log" : "linear" };
    if (logarithmic) Object.assign(layout, { tickformat: "~r", nticks: most / least > 6 ? Math.max(3, Math.ceil(Math.log10(most / least))) : undefined });
    return { place: (one) => value(one, name), layout };
  }

  function hover(one) {
    const said = varied.map((name) => `${name} = ${short(value(one, name))}`);
    const found = ["max_k", "mean_k", "gap"].filter((name) => number(name) >= 0 && value(one, name) !== null);
    return [`case ${one.case}`, ...said, ...found.map((name) => `${name} ${value(one, name).toFixed(4)}`)].join("<br>");
  }

  // Groups of cases with a value in common, each with a number that it keeps whatever is shown; one group for no column.
  function groups(rows, name) {
    if (name === "") return [{ name: "cases", index: 1, rows }];
    return distinct(cases, name).map((common, index) => ({ name: `${short(common)}`, index, rows: rows.filter((one) => value(one, name) === common) })).filter((group) => group.rows.length > 0);
  }

  function points(rows, place, { name, index }) {
    return {
      type: "scatter", mode: "markers", name, meta: index % 6, marker: { size: 8, symbol: symbols[index % symbols.length] },
      x: rows.map((one) => place[0](one)), y: rows.map((one) => place[1](one)),
      hovertext: rows.map(hover), hovertemplate: "%{hovertext}<extra></extra>", customdata: rows.map((one) => one.link),
    };
  }

  // The cases that no other is below in one of the two and not above in the other.
  function front(rows, place) {
    let least = Infinity;
    return [...rows].sort((a, b) => place[0](a) - place[0](b) || place[1](a) - place[1](b)).filter((one) => {
      const better = place[1](one) < least;
      least = Math.min(least, place[1](one));
      return better;
    });
  }

  function line(rows, place, { name, index }) {
    return { type: "scatter", mode: "lines", name, meta: index % 6, line: { width: 1.5 }, showlegend: false, hoverinfo: "skip", x: rows.map(place[0]), y: rows.map(place[1]) };
  }

  function plot(box, traces, layout, small) {
    const options = { ...settings, displayModeBar: small || narrow.matches ? false : "hover" };
    const drawn = Plotly.react(box, coloured(traces), themed({ showlegend: !small && traces.length > 1, hovermode: "closest", margin: { l: 60, r: 16, t: small ? 10 : 40, b: 48 }, ...layout }), options);
    // A figure that is used again may have another width.
    Plotly.Plots.resize(box);
    if (!box.dataset.opens) {
      box.dataset.opens = "yes";
      box.on("plotly_click", ({ points: [point] }) => { if (point.customdata) window.open(point.customdata); });
    }
    return drawn;
  }

  // The figures of a place, one for each title, used again: plotly.js may still be at work on one when the next is asked for.
  const pools = { explorer: [], along: [] };
  function figures(place, titles) {
    const pool = pools[place];
    while (pool.length < titles.length) {
      const [whole, caption, box] = ["figure", "figcaption", "div"].map((tag) => document.createElement(tag));
      box.className = "chart";
      whole.append(caption, box);
      pool.push({ whole, caption, box });
    }
    const used = pool.slice(0, titles.length);
    titles.forEach((title, index) => { used[index].caption.textContent = title; });
    byId(place).replaceChildren(...used.map((one) => one.whole));
    return used.map((one) => one.box);
  }

  function explore(rows) {
    const [x, y, colour, facet] = ["x", "y", "colour-by", "facet"].map((id) => byId(id).value);
    const there = rows.filter((one) => value(one, x) !== null && value(one, y) !== null);
    const axes = [axis(x, there), axis(y, there)];
    const place = axes.map((one) => one.place);
    const shades = colour !== "" && isNumeric(colour) && distinct(cases, colour).length > 6;
    const parts = facet === "" ? [{ name: "", rows: there }] : groups(there, facet);
    byId("explorer").className = facet === "" ? "" : "multiples";
    const boxes = figures("explorer", parts.map((part) => (facet === "" ? `${y} over ${x}, a point a case` : `${facet} = ${part.name}`)));
    parts.forEach((part, index) => {
      const within = groups(part.rows, shades ? "" : colour);
      const traces = within.map((group) => {
        const trace = points(group.rows, place, group);
        if (shades) {
          const values = group.rows.map((one) => value(one, colour));
          Object.assign(trace, { meta: undefined, marker: { ...trace.marker, color: values, colorscale: scale, showscale: true, colorbar: { title: { text: colour }, thickness: 12 } } });
        }
        return trace;
      });
      const fronts = byId("front").checked && isNumeric(x) ? within.map((group) => line(front(group.rows, place), place, group)) : [];
      plot(boxes[index], [...fronts, ...traces], { xaxis: { ...axes[0].layout }, yaxis: { ...axes[1].layout }, showlegend: within.length > 1 }, facet !== "" && parts.length > 2);
    });
  }

  // max K along each key, with the median at each value; and the gap of each case, from the least.
  function overview(rows) {
    const measured = rows.filter((one) => value(one, "max_k") !== null);
    const gaps = measured.filter((one) => number("gap") >= 0 && value(one, "gap") !== null).sort((a, b) => value(a, "gap") - value(b, "gap"));
    const titles = keys.map((key) => `max_k over ${key}`).concat(gaps.length > 0 ? ["gap, of the cases that have one, from the least"] : []);
    const boxes = figures("along", titles);
    keys.forEach((key, index) => {
      const axes = [axis(key, measured), axis("max_k", measured)];
      const place = axes.map((one) => one.place);
      const medians = groups(measured, key).map((group) => [...group.rows].sort((a, b) => place[1](a) - place[1](b))[Math.floor((group.rows.length - 1) / 2)]);
      const median = line(medians, place, { name: "median", index: 0 });
      // Nothing lies between two words.
      if (!isNumeric(key)) Object.assign(median, { mode: "markers", marker: { size: 22, symbol: "line-ew-open", line: { width: 3 } } });
      const traces = [median, points(measured, place, { name: "cases", index: 1 })];
      plot(boxes[index], traces, { xaxis: axes[0].layout, yaxis: axes[1].layout }, true);
    });
    if (gaps.length > 0) {
      const ranks = new Map(gaps.map((one, at) => [one, at + 1]));
      const trace = points(gaps, [(one) => ranks.get(one), (one) => value(one, "gap")], { name: "gap", index: 2 });
      plot(boxes.at(-1), [trace], { xaxis: { title: { text: "case, by its gap" }, automargin: true }, yaxis: axis("gap", gaps).layout }, true);
    }
  }

  // A table of the least value for each two values of two keys.
  function heat(rows) {
    if (keys.length < 2) return;
    const [down, across, name] = ["heat-rows", "heat-columns", "heat-value"].map((id) => byId(id).value);
    const [downs, acrosses] = [down, across].map((key) => distinct(cases, key));
    const least = (a, b) => {
      const values = rows.filter((one) => value(one, down) === a && value(one, across) === b).map((one) => value(one, name)).filter((one) => one !== null);
      return values.length > 0 ? Math.min(...values) : null;
    };
    const table = downs.map((a) => acrosses.map((b) => least(a, b)));
    const all = table.flat().filter((one) => one !== null);
    const [low, high] = [Math.min(...all), Math.max(...all)];
    const head = document.createElement("tr");
    head.append(...[`${down} \\ ${across}`, ...acrosses.map(short)].map((words) => Object.assign(document.createElement("th"), { textContent: words })));
    const lines = table.map((values, row) => {
      const line = document.createElement("tr");
      line.append(Object.assign(document.createElement("th"), { textContent: short(downs[row]) }));
      for (const one of values) {
        const cell = Object.assign(document.createElement("td"), { className: "number", textContent: one === null ? "" : Number.isInteger(one) ? one : one.toFixed(4) });
        if (one !== null) {
          const colour = ramp[high > low ? Math.round(((one - low) / (high - low)) * (ramp.length - 1)) : 0];
          const light = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255).map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4));
          cell.style.background = colour;
          // The darker or lighter of the two, whichever has more contrast.
          cell.style.color = 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2] > 0.179 ? "#000" : "#fff";
        }
        line.append(cell);
      }
      return line;
    });
    byId("heat-table").replaceChildren(head, ...lines);
  }

  const draw = (which) => {
    const rows = shownCases.map((index) => cases[index]);
    which.forEach((one) => one(rows));
  };
  redrawSweep = () => draw([explore, overview, heat]);
  redrawSweep();
  drawn.push(redrawSweep);
  for (const id of ["x", "y", "colour-by", "facet", "front"]) byId(id).addEventListener("input", () => draw([explore]));
  for (const id of ["heat-rows", "heat-columns", "heat-value"]) byId(id).addEventListener("input", () => draw([heat]));
}
