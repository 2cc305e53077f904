/* Start what the page has. */
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const makers = { field: deviationField, stations: campaignScene };
  for (const root of document.querySelectorAll("[data-scene]")) {
    const own = data[root.dataset.scene];
    if (own) Scenes.mount(root, makers[root.dataset.scene](root, own));
  }
})();
