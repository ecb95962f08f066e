/** Whether the bridge serves the map, for the components that show it. */
export { servesScene } from "../../api/http";
