// Lets dancers be dragged over the floor plan of a notebook; the kernel hears of a drop only.
async (manager, facts) => {
  const part = {};
  const begun = performance.now();
  for (const [name, id] of Object.entries(facts.models)) {
    while (!manager.has_model(id)) {
      if (performance.now() - begun > 60_000) return; // the kernel has closed it meanwhile
      await new Promise((go) => setTimeout(go, 50));
    }
    part[name] = await manager.get_model(id);
  }
  const { picture, places } = part;
  const middle = facts.reach * facts.pixels;
  let held = null; // the disc, from where on it was taken, and whether it was moved

  async function isOurs(disc) {
    for (const view of Object.values(picture.views ?? {})) {
      if ((await view).el.contains(disc)) return true;
    }
    return false;
  }

  const place = (disc) => disc.transform.baseVal.getItem(0).matrix;

  async function take(event) {
    const disc = event.target.closest?.("g[data-dancer]");
    if (!disc || event.button || held || !(await isOurs(disc))) return;
    const at = place(disc);
    held = { disc, x: at.e - event.clientX, y: at.f - event.clientY, moved: false };
    document.addEventListener("pointermove", move);
    for (const end of ["pointerup", "pointercancel"]) document.addEventListener(end, drop);
  }

  function move(event) {
    if (!event.buttons) return drop(); // it was let go where nobody saw it
    const onFloor = (value) => Math.min(Math.max(value, 0), 2 * middle);
    const [x, y] = [onFloor(held.x + event.clientX), onFloor(held.y + event.clientY)];
    held.disc.setAttribute("transform", `translate(${x} ${y})`);
    held.moved = true;
  }

  function drop() {
    document.removeEventListener("pointermove", move);
    for (const end of ["pointerup", "pointercancel"]) document.removeEventListener(end, drop);
    const { disc, moved } = held;
    held = null;
    if (!moved) return; // a click moves nobody
    const most = Math.floor(facts.reach * 20 + 1e-6); // twentieths of a metre that are on the floor
    const twentieths = (pixel) => Math.round(((pixel - middle) / facts.pixels) * 20);
    const metres = (pixel) => Math.min(Math.max(twentieths(pixel), -most), most) / 20;
    const all = JSON.parse(places.get("value")); // who was not dragged stays to the millimetre
    all[disc.dataset.dancer] = [metres(place(disc).e), metres(place(disc).f)];
    places.set("value", JSON.stringify(all));
    places.save_changes();
  }

  // the picture is drawn anew after every drop, so it is the page that is listened to
  document.addEventListener("pointerdown", take);
  picture.once("destroy", () => document.removeEventListener("pointerdown", take));
}
