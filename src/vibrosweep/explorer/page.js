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
const bare = (from) => (from instanceof Map ? Object.fromEntries(from) : from)
// Values of the cells of a grid, as `raster` in Python: means of numbers, or commonest codes
const gathered = (grid, values, codes) => {
  const index = get(grid, "index"), [rows, across] = get(grid, "shape")
  const found = new Array(rows * across).fill(NaN)
  const total = found.map(() => 0), known = found.map(() => 0)
  const counts = found.map(() => new Array(codes).fill(0))
  values.forEach((v, i) => {
    const at = index[i]
    if (codes) {
      if (isNaN(v)) return
      counts[at][v] += 1
      found[at] = counts[at].indexOf(Math.max(...counts[at]))
    } else if (isFinite(v)) {
      total[at] += v
      known[at] += 1
      found[at] = total[at] / known[at]
    } else if (v === -Infinity && !known[at]) found[at] = v
  })
  return found
}
const said = (v, words) => (
  isNaN(v) ? "not known" : get(words, `${v}`) ?? `${Number(v.toPrecision(6))}`
)
const repaint = () => {
  const names = pickers.map((picker) => picker.value)
  const [x, y, quantity] = names.map((name) => columns.data[name])
  const [across, up, label] = names.map((name) => get(views, name)[2])
  const colouring = get(colourings, names[2]), grid = get(get(grids, names[0]), names[1])
  const values = get(colouring, "values"), words = get(colouring, "words")
  const scaled = (all) => Array.from(all, get(colouring, "log") ? Math.log : Number)
  mapper.setv(bare(get(colouring, "mapping")))
  bar.setv(bare(get(colouring, "bar")))
  plane.title.text = get(colouring, "title")
  dots.data = {
    ...dots.data, x: x, y: y, value: scaled(values),
    said: Array.from(quantity, (v) => said(v, words)),
    alpha: Array.from(values, () => (grid ? 0 : 1)),
  }
  if (grid) {
    const found = scaled(gathered(grid, values, get(colouring, "names").length))
    const cells = new columns.data[names[0]].constructor(found, get(grid, "shape"))
    image.data = {image: [cells], ...bare(get(grid, "place"))}
  } else image.data = {image: [], x: [], y: [], dw: [], dh: []}
  const tips = (x, y, value) => [[across, `${x}{%.6g}`], [up, `${y}{%.6g}`], [label, value]]
  over_cells.tooltips = tips("$x", "$y", "@image{%.6g}")
  over_dots.tooltips = tips("@x", "@y", "@said")
  over_dots.renderers = grid ? [] : [renderer]
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
else if (cb_obj === pickers[2]) repaint()
else if (pickers.includes(cb_obj)) move()
else choose()
