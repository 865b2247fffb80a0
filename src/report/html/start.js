if (embedded) await startViewer();
// Times in milliseconds since the page was opened: when the viewer could be used, and when all was drawn.
root.dataset.ready = Math.round(performance.now());
// The library of the charts stands packed in the page: it is read once the viewer is on the screen.
const library = document.getElementById("plotly");
if (library) {
  // Two frames on, the first is there; a page in the background has none.
  if (embedded) await new Promise((done) => { requestAnimationFrame(() => requestAnimationFrame(done)); setTimeout(done, 500); });
  document.head.append(Object.assign(document.createElement("script"), { textContent: new TextDecoder().decode(await unpack(library.textContent, Uint8Array)) }));
}
await drawCharts();
if (sweepData) await startSweep();
root.dataset.complete = Math.round(performance.now());
