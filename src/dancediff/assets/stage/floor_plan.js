// Lets dancers be dragged over the floor plan of a notebook; the kernel hears of a drop only.
async (manager, facts) => {
  const part = {};
  for (const [name, id] of Object.entries(facts.models)) {
    while (!manager.has_model(id)) await new Promise((go) => setTimeout(go, 50));
    part[name] = await manager.get_model(id);
  }
  const { picture, places } = part;
  const middle = facts.reach * facts.pixels;
  let held = null; // the disc, and from where on it was taken

  async function isOurs(disc) {
    for (const view of Object.values(picture.views ?? {})) {
      if ((await view).el.contains(disc)) return true;
    }
    return false;
  }

  const place = (disc) => disc.transform.baseVal.getItem(0).matrix;

  // the picture is drawn anew after every drop, so it is the page that is listened to
  document.addEventListener("pointerdown", async (event) => {
    const disc = event.target.closest?.("g[data-dancer]");
    if (!disc || !(await isOurs(disc))) return;
    const at = place(disc);
    held = { disc, x: at.e - event.clientX, y: at.f - event.clientY };
  });

  document.addEventListener("pointermove", (event) => {
    if (!held) return;
    const onFloor = (value) => Math.min(Math.max(value, 0), 2 * middle);
    const x = onFloor(held.x + event.clientX);
    const y = onFloor(held.y + event.clientY);
    held.disc.setAttribute("transform", `translate(${x} ${y})`);
  });

  document.addEventListener("pointerup", () => {
    if (!held) return;
    const discs = held.disc.parentNode.querySelectorAll("g[data-dancer]");
    held = null;
    const metres = (pixel) => Math.round(((pixel - middle) / facts.pixels) * 20) / 20;
    const dropped = [...discs].map((disc) => [metres(place(disc).e), metres(place(disc).f)]);
    places.set("value", JSON.stringify(dropped));
    places.save_changes();
  });
}
