// Opened from the disk, a browser allows the search no worker: it is left out there instead of failing.
if (location.protocol === "file:") {
  window.Worker = function () { this.postMessage = () => {}; };
  document.querySelectorAll('[data-target="#mkdocs_search_modal"], [data-bs-target="#mkdocs_search_modal"]')
    .forEach((opener) => opener.remove());
}
