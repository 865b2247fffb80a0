// Draws the charts and follows the theme.
const charts = JSON.parse(document.getElementById("charts").textContent);
const root = document.documentElement;
const dark = matchMedia("(prefers-color-scheme: dark)");
const narrow = matchMedia("(max-width: 640px)");
const settings = { responsive: true, displaylogo: false };
const drawn = [];

function colours() {
  const style = getComputedStyle(root);
  const [text, line, dim] = ["--text", "--line", "--dim"].map((name) => style.getPropertyValue(name).trim());
  return { text, line, dim, tools: { bgcolor: "rgba(0,0,0,0)", color: dim, activecolor: text } };
}

// Traces in the colours of the theme, for the series whose number they carry.
function coloured(traces) {
  const style = getComputedStyle(root);
  return traces.map((trace) => {
    if (trace.meta === undefined) return trace;
    const color = style.getPropertyValue(`--series-${trace.meta}`).trim();
    return { ...trace, line: { ...trace.line, color }, marker: { ...trace.marker, color } };
  });
}

function themed(layout) {
  const { text, line, tools } = colours();
  const axis = { gridcolor: line, linecolor: line, zerolinecolor: line };
  return {
    ...layout,
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: text, family: "system-ui, sans-serif" },
    xaxis: { ...layout.xaxis, ...axis },
    yaxis: { ...layout.yaxis, ...axis },
    modebar: tools,
    legend: { bgcolor: "rgba(0,0,0,0)", orientation: "h", y: 1.02, yanchor: "bottom" },
  };
}

function setTheme(name) {
  root.dataset.theme = name;
  document.getElementById("theme").textContent = name === "dark" ? "Light theme" : "Dark theme";
  drawn.forEach((draw) => draw());
}

setTheme(dark.matches ? "dark" : "light");
dark.addEventListener("change", () => setTheme(dark.matches ? "dark" : "light"));
document.getElementById("theme").addEventListener("click", () => setTheme(root.dataset.theme === "dark" ? "light" : "dark"));

// One after the other, so that the page answers in between.
async function drawCharts() {
  for (const [id, { data, layout }] of Object.entries(charts)) {
    const small = document.getElementById(id).closest(".multiples") !== null;
    const draw = () => Plotly.react(id, coloured(data), themed(layout), { ...settings, displayModeBar: small || narrow.matches ? false : "hover" });
    await new Promise((done) => setTimeout(done));
    drawn.push(draw);
    draw();
  }
}
