// Reactions of a page without a server; `get` reads what Bokeh passes as a Map or an object.
const get = (from, key) => (from instanceof Map ? from.get(key) : from[key])
const size = (range, pixels) => Math.abs(range.end - range.start) / (pixels || 400)
// Put the state of the page into its address; a page within another one has none of its own
const say = () => {
  if (location.protocol === "about:") return
  const [x, y, colour] = pickers.map((picker) => picker.value), [kind, low, high] = scales
  const state = {x: x, y: y, colour: colour, point: shown.data.index[0]}
  if (kind.value !== "automatic") state.scale = kind.value
  if (low.value !== null) state.from = low.value
  if (high.value !== null) state.to = high.value
  const {x_range, y_range} = plane
  const moved = [x_range, y_range].some((r) => r.start !== r.reset_start || r.end !== r.reset_end)
  if (moved) state.window = [x_range.start, x_range.end, y_range.start, y_range.end].join(",")
  if (pin.active) state.pinned = shown.data.index[1]
  history.replaceState(null, "", `${location.href.split("#")[0]}#${new URLSearchParams(state)}`)
}
const place = (source, index) => {
  const at = index === undefined ? [] : [kept[index]]
  source.data = {x: at.map((i) => dots.data.x[i]), y: at.map((i) => dots.data.y[i])}
}
// Keep the motion that is shown as the second one, or no longer
const keep = () => {
  const [index, asked] = shown.data.index, other = asked ?? index
  shown.data = {index: pin.active ? [index, other] : [index]}
  place(pinned, shown.data.index[1])
  const second = document.getElementById("motion-2")
  second.hidden = !pin.active
  if (pin.active) beside.data = {content: [motions[other]]}
  say()
}
const show = (index) => {
  const motion = motions[index]
  holder.data = {content: [motion]}
  facts.text = get(motion, "facts")
  const parts = get(around, picture.value)
  code.text = parts[1] ? parts[0] + get(motion, "call") + parts[1] : parts[0]
  shown.data = {index: [index, ...shown.data.index.slice(1)]}
  place(ring, index)
  place(pinned, shown.data.index[1])
  say()
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
// Colours of a quantity: of its kind of scale, between the ends that are wished if they leave one
const wished = (name) => {
  const kinds = get(colourings, name), [kind, low, high] = scales
  const colouring = get(kinds, kind.value) ?? get(kinds, "automatic")
  for (const field of scales) field.visible = get(colouring, "names").length === 0
  const mapping = bare(get(colouring, "mapping")), scale = bare(get(colouring, "bar"))
  const log = get(colouring, "log"), [least, most] = get(colouring, "ends")
  const ends = [low.value ?? least, high.value ?? most]
  const follows = low.value !== null || high.value !== null
  if (!low.visible || !follows || !(ends[0] < ends[1]) || (log && !(ends[0] > 0)))
    return {colouring, mapping, scale}
  const [a, b] = log ? ends.map(Math.log) : ends
  const places = [1e-6, 0.25, 0.5, 0.75, 1 - 1e-6].map((part) => a + part * (b - a))
  ticks.ticks = log ? places.map(Math.exp) : places
  const beyond = [0, 1].map((i) => columns.data[name].some((v) => (i ? v > ends[1] : v < ends[0])))
  const labels = new Map(ticks.ticks.map((v) => [v, `${Number(v.toPrecision(3))}`]))
  if (beyond[0]) labels.set(ticks.ticks[0], `▼ ${Number(ends[0].toPrecision(3))}`)
  if (beyond[1]) labels.set(ticks.ticks[4], `▲ ${Number(ends[1].toPrecision(3))}`)
  const {palette} = mapping, {constructor} = scale.color_mapper
  const new_mapper = new constructor({palette: palette, low: ends[0], high: ends[1]})
  return {
    colouring,
    mapping: {...mapping, low: a, high: b},
    scale: {...scale, ticker: ticks, major_label_overrides: labels, color_mapper: new_mapper},
  }
}
const repaint = () => {
  const names = pickers.map((picker) => picker.value)
  const [x, y, quantity] = names.map((name) => columns.data[name])
  const [across, up, label] = names.map((name) => get(views, name)[2])
  const {colouring, mapping, scale} = wished(names[2])
  const grid = get(get(grids, names[0]), names[1])
  const values = get(colouring, "values") ?? quantity, words = get(colouring, "words")
  const scaled = (all) => Array.from(all, get(colouring, "log") ? Math.log : Number)
  mapper.setv(mapping)
  bar.setv(scale)
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
// Restore the state that the address asks for
const restore = () => {
  const asked = new URLSearchParams(opened.slice(1)), [kind, low, high] = scales
  const index = (name) => (Number(asked.get(name)) in motions ? Number(asked.get(name)) : 0)
  const number = (name) => {
    const found = parseFloat(asked.get(name))
    return isFinite(found) ? found : null
  }
  pickers.forEach((picker, i) => {
    const name = asked.get(["x", "y", "colour"][i])
    if (name in columns.data) picker.value = name
  })
  if (kind.options.includes(asked.get("scale"))) kind.value = asked.get("scale")
  low.value = number("from")
  high.value = number("to")
  const window = (asked.get("window") ?? "").split(",").map(parseFloat)
  if (window.length === 4 && window.every(isFinite)) {
    plane.x_range.setv({start: window[0], end: window[1]})
    plane.y_range.setv({start: window[2], end: window[3]})
  }
  if (asked.has("pinned")) shown.data = {index: [0, index("pinned")]} // before `keep` looks at it
  pin.active = asked.has("pinned")
  show(index("point"))
}
const event = cb_data?.event_name ?? cb_obj.event_name // that of a document is in cb_data
if (event === "document_ready") { if (opened.length > 1) restore() }
else if (event === "rangesupdate") say()
else if (cb_obj === pin) keep()
else if (scales.includes(cb_obj)) { repaint(); say() }
else if (event === "tap") click(cb_obj.x, cb_obj.y)
else if (event === "button_click") table()
else if (cb_obj === picture) show(shown.data.index[0])
else if (cb_obj === pickers[2]) {
  scales.forEach((field, i) => { field.value = ["automatic", null, null][i] })
  repaint()
  say()
}
else if (pickers.includes(cb_obj)) move()
else choose()
