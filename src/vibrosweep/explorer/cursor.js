// Shows one time in all pictures of a motion: lines where the axis is the time, and dots where the
// particles are and where they last were in the return map.
const t = cb_obj.value
const show = (model, changes) => model.setv(changes, {sync: false})
for (const span of spans) show(span, {location: t, visible: true})
const height = {x: [], y: [], particle: []}
const put = (to, x, y, particle) => { to.x.push(x); to.y.push(y); to.particle.push(particle) }
for (const data of [sources.flights.data, sources.stays.data]) {
  const {start, end, y_start, y_end, cy, particle} = data
  for (let i = 0; i < start.length; i++) {
    if (t < start[i] || t >= end[i]) continue
    const s = (t - start[i]) / (end[i] - start[i]), middle = cy ? cy[i] : (y_start[i] + y_end[i]) / 2
    const y = (1 - s) ** 2 * y_start[i] + 2 * s * (1 - s) * middle + s ** 2 * y_end[i]
    put(height, t, y, particle[i])
  }
}
const last = new Map(), map = sources["return map"].data
map.landing_time.forEach((at, i) => {
  const held = last.get(map.particle[i])
  if (at <= t && !(held !== undefined && map.landing_time[held] > at)) last.set(map.particle[i], i)
})
const returned = {x: [], y: [], particle: []}
for (const [particle, i] of last) {
  put(returned, map.arrival_speed[i], map.next_arrival_speed[i], particle)
}
show(there.height, {data: height})
show(there["return map"], {data: returned})
