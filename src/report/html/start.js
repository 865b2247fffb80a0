if (embedded) await startViewer();
// Times in milliseconds since the page was opened: when the viewer could be used, and when all was drawn.
root.dataset.ready = Math.round(performance.now());
await drawCharts();
if (sweepData) await startSweep();
root.dataset.complete = Math.round(performance.now());
