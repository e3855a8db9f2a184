// Reactions of a page without a server; `get` reads what Bokeh passes as a Map or an object.
const get = (from, key) => (from instanceof Map ? from.get(key) : from[key])
const size = (range, pixels) => Math.abs(range.end - range.start) / (pixels || 400)
const show = (index) => {
  const motion = motions[index]
  holder.data = {content: [motion]}
  facts.text = get(motion, "facts")
  const parts = get(around, picture.value)
  code.text = parts[1] ? parts[0] + get(motion, "call") + parts[1] : parts[0]
  const at = kept[index]
  ring.data = {x: [dots.data.x[at]], y: [dots.data.y[at]]}
  shown.data = {index: [index]}
}
const click = (x, y) => {
  const dx = size(plane.x_range, plane.inner_width), dy = size(plane.y_range, plane.inner_height)
  let best = 0, least = Infinity
  kept.forEach((at, index) => {
    const far = Math.hypot((dots.data.x[at] - x) / dx, (dots.data.y[at] - y) / dy)
    if (far < least) { least = far; best = index }
  })
  show(best)
}
const repaint = () => {
  const colouring = get(colourings, pickers[2].value)
  const values = get(colouring, "values"), names = get(colouring, "names")
  const scale = get(colouring, "scale")
  const bare = scale instanceof Map ? Object.fromEntries(scale) : scale
  const [x, y] = pickers.slice(0, 2).map((picker) => columns.data[picker.value])
  const said = Array.from(values, (v) => (names.length ? names[v] ?? "not known" : `${v}`))
  dots.data = {...dots.data, x: x, y: y, value: values, said: said}
  renderer.glyph.fill_color = {field: "value", transform: bare.color_mapper}
  plane.title.text = get(colouring, "title")
  bar.setv(bare)
  marks.data = {x: Array.from(kept, (at) => x[at]), y: Array.from(kept, (at) => y[at])}
}
const move = () => {
  repaint()
  const axes = [[plane.x_range, plane.below[0]], [plane.y_range, plane.left[0]]]
  axes.forEach(([range, axis], i) => {
    const [low, high, label] = get(views, pickers[i].value)
    range.setv({start: low, end: high, reset_start: low, reset_end: high})
    axis.axis_label = label
  })
  const first = pickers[0].value === initial[0] && pickers[1].value === initial[1]
  for (const curve of curves) curve.visible = first
  show(shown.data.index[0])
}
const choose = () => {
  const count = dots.selected.indices.length
  save.disabled = count === 0
  selection.text = count ? `<b>${count} points are chosen</b>` : "No point is chosen."
}
const table = () => {
  const rows = dots.selected.indices.map((i) => varied.map((n) => columns.data[n][i]).join(","))
  const text = [varied.join(","), ...new Set(rows)].join("\n") + "\n"
  const link = document.createElement("a")
  link.href = URL.createObjectURL(new Blob([text], {type: "text/csv"}))
  link.download = file
  link.click()
  URL.revokeObjectURL(link.href)
}
if (cb_obj.event_name === "tap") click(cb_obj.x, cb_obj.y)
else if (cb_obj.event_name === "button_click") table()
else if (cb_obj === picture) show(shown.data.index[0])
else if (pickers.includes(cb_obj)) move()
else choose()
