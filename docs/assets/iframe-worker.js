// SPDX-License-Identifier: Apache-2.0
// Browsers start no web worker from file://. There the search runs in a hidden frame instead.
if (location.protocol === "file:")
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.appendChild(frame);
      const scope = frame.contentWindow;
      const base = new URL(url, location);
      const load = (address) =>
        new Promise((loaded, failed) => {
          const script = scope.document.createElement("script");
          Object.assign(script, { src: new URL(address, base).href, onload: loaded, onerror: failed });
          scope.document.head.appendChild(script);
        });
      scope.importScripts = (...addresses) => Promise.all(addresses.map(load));
      scope.postMessage = (data) => this.answer(data);
      this.scope = scope;
      this.ready = load(base);
    }
    answer(data) {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      if (this.onmessage) this.onmessage(event);
    }
    postMessage(data) {
      const event = new MessageEvent("message", { data });
      this.ready.then(() => this.scope.dispatchEvent(event));
    }
    terminate() {}
  };
