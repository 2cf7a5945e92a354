(() => {
  // Each video is in the page once: its link takes it from there.
  document.querySelectorAll("figure").forEach((f) => {
    const link = f.querySelector("a[download]");
    if (link) link.href = f.querySelector("video").src;
  });
  const videos = [...document.querySelectorAll("#videos video")];
  const controls = document.querySelector("#videos .controls");
  const [button, slider] = controls.children;
  let leader = videos[0];
  const each = (action) => videos.forEach(action);
  const seek = (time) => each((v) => { v.currentTime = Math.min(time, v.duration || time); });
  const play = () => each((v) => v.play().catch(() => {}));
  const pause = () => each((v) => v.pause());
  const follow = () => {  // the others keep to the longest video's time
    slider.value = leader.currentTime / (leader.duration || 1);
    each((v) => {
      const time = Math.min(leader.currentTime, v.duration || 0);
      if (!leader.paused && Math.abs(v.currentTime - time) > 0.15) v.currentTime = time;
    });
    requestAnimationFrame(follow);
  };
  const start = () => {
    leader = videos.reduce((a, b) => (b.duration > a.duration ? b : a));
    each((v) => { v.loop = false; });
    leader.addEventListener("ended", () => { seek(0); play(); });
    leader.addEventListener("play", () => { button.textContent = "Pause"; });
    leader.addEventListener("pause", () => { button.textContent = "Play"; });
    button.addEventListener("click", () => (leader.paused ? play() : pause()));
    slider.addEventListener("input", () => { pause(); seek(slider.value * leader.duration); });
    controls.hidden = false;
    requestAnimationFrame(follow);
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play();
  };
  Promise.all(videos.map((v) => v.readyState ? 0 : new Promise((done) => {
    v.addEventListener("loadedmetadata", done, { once: true });
    v.addEventListener("error", done, { once: true });
  }))).then(start);
  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
})();
